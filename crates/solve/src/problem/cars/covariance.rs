//! What the factorisation says beside the step: covariances, and how cars follow the camera.

use nalgebra::{Matrix4, Vector4};

use super::{CarsProblem, Linearisation, View};
use crate::linear::arrow::{Joint, PoseBlock};
use crate::model::pose::Pose;

/// What is known of the camera at the current parameters.
pub(crate) struct Covariances {
    /// Information on the camera from the cars alone, without the camera prior.
    pub camera_information: Matrix4<f64>,
    /// Covariance of the camera, prior counted; zero rows where fixed.
    pub camera: Matrix4<f64>,
}

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// What is known of the camera at the current parameters, from the same elimination with damping 0. Call after `linearise`.
    /// A coefficient at its bound is not exactly known: it counts as free.
    pub fn covariances(&mut self) -> Option<Covariances> {
        for block in &mut self.group_blocks {
            block.held = [self.shapes_fixed; M];
        }
        let (information, _) = self.eliminate(0.0)?;
        let camera = self.knowledge.covariance(&information, &self.state.camera)?;
        Some(Covariances { camera_information: information, camera })
    }

    /// Per view the covariance of (anchor, heading, shape, camera), given that of the camera. After `covariances`.
    pub fn view_covariances(&self, camera: &Matrix4<f64>) -> Vec<Joint> {
        let shared: Vec<Joint> = self.group_blocks.iter().map(|block| block.joint(camera)).collect();
        let joint = |(view, pose): (&View, &PoseBlock<N, M>)| {
            let mut joint = shared[view.group];
            pose.spread(&mut joint);
            joint
        };
        self.views.iter().zip(&self.pose_blocks).map(joint).collect()
    }

    /// That of a problem of one view, the camera's own covariance counted.
    pub fn only_view_covariance(&mut self) -> Option<Joint> {
        let camera = self.covariances()?.camera;
        self.view_covariances(&camera).pop()
    }

    fn half_log_determinant_of(&self, linearisation: &Linearisation<N, M>) -> Option<f64> {
        let mut sum = 0.0;
        for (group, block) in self.groups.iter().zip(&self.group_blocks) {
            let grams = &linearisation.grams[group.views.clone()];
            let prior = group.prior_terms(&group.prior.mean, self.shape_prior_scale);
            sum += block.log_determinant(grams, &prior)?;
        }
        Some(0.5 * sum)
    }

    /// Moves the camera, and cars along the valley of the minimum. After `covariances`.
    pub fn follow(&mut self, change: &Vector4<f64>) {
        self.state.camera += change;
        for (g, group) in self.groups.iter().enumerate() {
            let mut step = self.group_blocks[g].step(change, 0.0);
            for j in 0..M {
                let [low, high] = self.model.bounds[j];
                self.state.shapes[g][j] = (self.state.shapes[g][j] + step[N + j]).clamp(low, high);
            }
            for k in group.views.clone() {
                self.pose_blocks[k].substitute(&mut step);
                self.state.poses[k] = self.state.poses[k].moved(&step);
            }
        }
    }

    /// L of `marginal.rs` at the current state. After `covariances`.
    pub fn half_log_determinant(&self) -> Option<f64> {
        self.half_log_determinant_of(&self.linearisation)
    }

    /// The same at a changed camera, cars following.
    pub fn half_log_determinant_at(&mut self, change: &Vector4<f64>) -> Option<f64> {
        self.trial.clone_from(&self.state);
        self.follow(change);
        std::mem::swap(&mut self.state, &mut self.trial);
        self.evaluate(true)?;
        self.half_log_determinant_of(&self.trial_linearisation)
    }
}
