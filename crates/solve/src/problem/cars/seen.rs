//! Fit of single keypoints at the current state.

use roadplane_base::KEYPOINTS;

use super::CarsProblem;
use crate::linear::gram::{Gram, MAX_WIDTH};
use crate::model::pose::{CameraFrame, Pose};
use crate::model::rows::plain_rows;

/// Whitened derivatives and residual of one keypoint, and the probability that the keypoint is right.
pub(crate) struct KeypointRows {
    /// Derivatives and residual, multiplied by the root of the keypoint's weight. `rows.rs` lists the columns.
    pub rows: [[f64; MAX_WIDTH]; 2],
    /// Weight of the keypoint.
    pub weight: f64,
    /// Probability that the keypoint is right, 0–1: the derivative ρ' of the robust loss.
    pub right: f64,
}

/// Quality of the fit of a view's keypoints.
pub(crate) struct ViewFit {
    /// Whether each keypoint is an inlier: more likely right than wrong.
    pub inliers: [bool; KEYPOINTS],
    /// Root mean square distance between the inliers and the projected keypoints of the fitted car, px.
    pub rms_px: f64,
    /// Sum of the keypoints' weights.
    pub weight: f64,
    /// Sum of the keypoints' weights, each multiplied by the probability that the keypoint is right.
    pub right_weight: f64,
    /// Cost of the keypoints, without the shape prior.
    pub cost: f64,
}

impl<P: Pose<N>, const N: usize, const M: usize> CarsProblem<'_, P, N, M> {
    /// Calls `see` with the derivatives and residual of each keypoint of a view.
    ///
    /// Returns `None` if a keypoint cannot be projected.
    pub fn each_row(&self, view: usize, mut see: impl FnMut(KeypointRows)) -> Option<()> {
        let frame = self.state.poses[view].frame(&CameraFrame::new(&self.state.camera))?;
        let view = &self.views[view];
        let observations = &self.observations[view.observations.clone()];
        plain_rows(&self.packs[view.packs.clone()], &frame, &self.state.shapes[view.group], |i, rows| {
            let weight = observations[i].weight;
            let off = |axis: usize| rows[axis][Gram::<N, M>::RESIDUAL];
            let squared = (off(0).powi(2) + off(1).powi(2)) / weight;
            see(KeypointRows { rows: *rows, weight, right: self.kernel.weight(squared) });
        })
    }

    /// Returns the quality of a view's fit; `None` if a keypoint cannot be projected.
    pub fn fit_of(&self, view: usize) -> Option<ViewFit> {
        let frame = self.state.poses[view].frame(&CameraFrame::new(&self.state.camera))?;
        let shape = &self.state.shapes[self.views[view].group];
        let mut inliers = [false; KEYPOINTS];
        let [mut weight, mut right_weight, mut cost, mut sum, mut count] = [0.0; 5];
        for o in &self.observations[self.views[view].observations.clone()] {
            let off = frame.project(&self.model.point(o.index, shape))? - o.pixel;
            let [x, y] = o.whiten([off.x, off.y]);
            let squared = x * x + y * y;
            let probability = self.kernel.weight(squared);
            weight += o.weight;
            right_weight += o.weight * probability;
            cost += 0.5 * o.weight * self.kernel.cost(squared);
            if probability > 0.5 {
                inliers[o.index] = true;
                sum += off.norm_squared();
                count += 1.0;
            }
        }
        let rms_px = if count > 0.0 { f64::sqrt(sum / count) } else { f64::INFINITY };
        Some(ViewFit { inliers, rms_px, weight, right_weight, cost })
    }
}
