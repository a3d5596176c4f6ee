//! What single keypoints say at the current state.

use nalgebra::Vector2;

use super::GroundProblem;
use crate::linear::gram::{MAX_WIDTH, residual};
use crate::model::ground::{CameraFrame, StandingFrame};
use crate::model::observation::Observation;
use crate::model::rows::plain_rows;

/// One keypoint's whitened rows and residual, with the probability that it is right.
pub(crate) struct KeypointRows {
    /// Unknowns and residual, in the order of `rows.rs`, times the root of the keypoint's weight.
    pub rows: [[f64; MAX_WIDTH]; 2],
    /// Its weight.
    pub weight: f64,
    /// ρ'.
    pub right: f64,
}

impl<const M: usize> GroundProblem<'_, M> {
    /// Calls with the rows of every observation of a view. `None` when a keypoint cannot be projected.
    pub fn each_row(&self, view: usize, mut see: impl FnMut(KeypointRows)) -> Option<()> {
        let camera = CameraFrame::new(&self.state.camera);
        let frame = StandingFrame::new(&camera, &self.state.standings[view])?;
        let view = &self.views[view];
        let observations = &self.observations[view.observations.clone()];
        plain_rows(&self.packs[view.packs.clone()], &frame, &self.state.shapes[view.group], |i, rows| {
            let weight = observations[i].weight;
            let squared = (rows[0][residual(M)].powi(2) + rows[1][residual(M)].powi(2)) / weight;
            see(KeypointRows { rows: *rows, weight, right: self.kernel.weight(squared) });
        })
    }

    /// Calls with every observation of a view, its pixel residual (predicted − measured) and the square of the whitened one.
    /// `None` when a keypoint cannot be projected.
    pub fn each_residual(
        &self,
        view: usize,
        mut see: impl FnMut(&Observation, Vector2<f64>, f64),
    ) -> Option<()> {
        let camera = CameraFrame::new(&self.state.camera);
        let frame = StandingFrame::new(&camera, &self.state.standings[view])?;
        let shape = &self.state.shapes[self.views[view].group];
        for observation in &self.observations[self.views[view].observations.clone()] {
            let point = self.model.point(observation.index, shape);
            let off = frame.project(&point)? - observation.pixel;
            let [rx, ry] = observation.whiten([off.x, off.y]);
            see(observation, off, rx * rx + ry * ry);
        }
        Some(())
    }
}
