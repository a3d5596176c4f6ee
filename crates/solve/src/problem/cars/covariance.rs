//! Covariances from the factorised normal equations, and the change of cars when the camera changes.

use nalgebra::{Matrix4, SVector, Vector4};

use super::{CarsProblem, View};
use crate::linear::arrow::{Joint, PoseBlock};
use crate::linear::gram::{Gram, MAX_WIDTH, Row};
use crate::model::pose::Pose;

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// Returns the cars' information (inverse covariance) on the camera at the current parameters.
    ///
    /// The camera's prior is not included. Poses and shapes are eliminated without damping. A shape
    /// coefficient at its bound is still uncertain, so it counts as free. Call after `linearise`. Returns `None` if a
    /// car's block is not positive definite.
    pub fn information(&mut self) -> Option<Matrix4<f64>> {
        for block in &mut self.group_blocks {
            block.fixed = [self.shapes_fixed; M];
        }
        self.eliminate(0.0).map(|(information, _)| information)
    }

    /// Returns the joint covariance of (pose, shape, camera) of each view, for the given covariance of the camera.
    ///
    /// Call after `information`.
    pub fn view_covariances(&self, camera: &Matrix4<f64>) -> Vec<Joint> {
        let shared: Vec<Joint> = self.group_blocks.iter().map(|block| block.joint(camera)).collect();
        let joint = |(view, pose): (&View, &PoseBlock<N, M>)| {
            let mut joint = shared[view.group];
            pose.spread(&mut joint);
            joint
        };
        self.views.iter().zip(&self.pose_blocks).map(joint).collect()
    }

    /// Returns the joint covariance of (pose, shape, camera) in a problem of one view.
    ///
    /// The camera's part includes its prior. Returns `None` if a matrix is not positive definite.
    pub fn only_view_covariance(&mut self) -> Option<Joint> {
        let information = self.information()?;
        let camera = self.knowledge.covariance(&information)?;
        self.view_covariances(&camera).pop()
    }

    /// Adds `change` to the camera, and moves each car to its minimum for the new camera, to first order.
    ///
    /// Call after `information`.
    pub fn follow(&mut self, change: &Vector4<f64>) {
        self.move_trial(&self.following(change).concat(), 1.0);
        std::mem::swap(&mut self.state, &mut self.trial);
        for shape in &mut self.state.shapes {
            for (coefficient, [low, high]) in shape.iter_mut().zip(&self.model.bounds) {
                *coefficient = coefficient.clamp(*low, *high);
            }
        }
    }

    /// Returns the change of (pose, shape, camera) in each view for a change of the camera.
    ///
    /// Poses and shapes stay at their minimum, to first order. Call after `information`.
    pub(super) fn following(&self, camera: &Vector4<f64>) -> Vec<Row> {
        let step = |(view, pose): (&View, &PoseBlock<N, M>)| {
            let mut step = self.group_blocks[view.group].step(camera, 0.0);
            pose.substitute(&mut step);
            step
        };
        self.views.iter().zip(&self.pose_blocks).map(step).collect()
    }

    /// Returns the d-th column of a matrix U for each view.
    ///
    /// U Uᵀ is the posterior covariance of (pose, shape) for a fixed camera.
    pub(super) fn own_column(&self, d: usize) -> Vec<Row> {
        let step = |(view, pose): (&View, &PoseBlock<N, M>)| {
            let root = self.groups[view.group].trust.sqrt();
            self.group_blocks[view.group].column(pose, d).map(|entry| entry / root)
        };
        self.views.iter().zip(&self.pose_blocks).map(step).collect()
    }

    /// Sets the trial state to the current state plus `length` times `steps`, and linearises the problem there.
    ///
    /// Returns the cost. `steps` has `MAX_WIDTH` numbers per view. All views of a group must have the same step of the
    /// shape.
    pub(super) fn evaluate_at(&mut self, steps: &[f64], length: f64) -> Option<f64> {
        self.move_trial(steps, length);
        self.evaluate(true)
    }

    fn move_trial(&mut self, steps: &[f64], length: f64) {
        self.trial.clone_from(&self.state);
        for (k, (view, step)) in self.views.iter().zip(steps.chunks_exact(MAX_WIDTH)).enumerate() {
            let step: Row = std::array::from_fn(|i| length * step[i]);
            let camera = Gram::<N, M>::CAMERA;
            self.trial.camera = self.state.camera + Vector4::from_column_slice(&step[camera..camera + 4]);
            self.trial.shapes[view.group] =
                self.state.shapes[view.group] + SVector::from_column_slice(&step[N..camera]);
            self.trial.poses[k] = self.state.poses[k].moved(&step);
        }
    }
}
