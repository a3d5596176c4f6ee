//! Covariances from the factorisation, and the motion of cars along with the camera.

use nalgebra::{Matrix4, SVector, Vector4};

use super::{CarsProblem, View};
use crate::linear::arrow::{Joint, PoseBlock};
use crate::linear::gram::{Gram, MAX_WIDTH, Row};
use crate::model::pose::Pose;

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// Returns the cars' information on the camera at the current parameters, without prior and factors.
    ///
    /// It comes from the elimination with damping 0. Call after `linearise`. A coefficient at its bound still has an
    /// uncertainty, so it counts as free.
    pub fn information(&mut self) -> Option<Matrix4<f64>> {
        for block in &mut self.group_blocks {
            block.fixed = [self.shapes_fixed; M];
        }
        self.eliminate(0.0).map(|(information, _)| information)
    }

    /// Returns per view the covariance of (pose, shape, camera) from that of the camera. Call after `information`.
    pub fn view_covariances(&self, camera: &Matrix4<f64>) -> Vec<Joint> {
        let shared: Vec<Joint> = self.group_blocks.iter().map(|block| block.joint(camera)).collect();
        let joint = |(view, pose): (&View, &PoseBlock<N, M>)| {
            let mut joint = shared[view.group];
            pose.spread(&mut joint);
            joint
        };
        self.views.iter().zip(&self.pose_blocks).map(joint).collect()
    }

    /// Returns the covariance of (pose, shape, camera) in a problem of one view, with the camera's own covariance.
    pub fn only_view_covariance(&mut self) -> Option<Joint> {
        let information = self.information()?;
        let camera = self.knowledge.covariance(&information, &self.state.camera)?;
        self.view_covariances(&camera).pop()
    }

    /// Moves the camera by `change`, and moves the cars so that they stay at their minimum. Call after `information`.
    pub fn follow(&mut self, change: &Vector4<f64>) {
        self.move_trial(&self.following(change).concat(), 1.0);
        std::mem::swap(&mut self.state, &mut self.trial);
        for shape in &mut self.state.shapes {
            for (coefficient, [low, high]) in shape.iter_mut().zip(&self.model.bounds) {
                *coefficient = coefficient.clamp(*low, *high);
            }
        }
    }

    /// Returns per view the change of (pose, shape, camera) for a change of the camera. Call after `information`.
    pub(super) fn following(&self, camera: &Vector4<f64>) -> Vec<Row> {
        let step = |(view, pose): (&View, &PoseBlock<N, M>)| {
            let mut step = self.group_blocks[view.group].step(camera, 0.0);
            pose.substitute(&mut step);
            step
        };
        self.views.iter().zip(&self.pose_blocks).map(step).collect()
    }

    /// Returns per view column d of U, where U Uᵀ is the posterior covariance of (pose, shape) given the camera.
    pub(super) fn own_column(&self, d: usize) -> Vec<Row> {
        let step = |(view, pose): (&View, &PoseBlock<N, M>)| {
            let root = self.groups[view.group].trust.sqrt();
            self.group_blocks[view.group].column(pose, d).map(|entry| entry / root)
        };
        self.views.iter().zip(&self.pose_blocks).map(step).collect()
    }

    /// Linearises the trial state after moving each view by `length` times its step.
    ///
    /// `steps` has `MAX_WIDTH` numbers per view; views of a group must have equal steps of the shape.
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
