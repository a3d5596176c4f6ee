//! Tables and plots of scores, one row per system, with intervals over scenes.

use roadplane_tables::{Cell, bootstrap};

mod poses;
mod tracks;

pub use poses::{add_plot, add_table, camera_table, steps_table, viewpoint_plot, viewpoint_table};
pub use tracks::{
    boxes_table, calibration_table, motion_table, position_plot, position_table, tracking_table,
};

/// Scores of a system: its name, and its scores in each scene.
pub type Scored<'a, T> = (&'a str, &'a [Vec<T>]);

/// Returns a statistic of one number of each score, with its interval over scenes.
fn cell<T>(
    scenes: &[Vec<T>],
    number: impl Fn(&T) -> f64,
    statistic: impl Fn(&[f64]) -> f64,
    factor: f64,
) -> Cell {
    let numbers: Vec<Vec<f64>> = scenes.iter().map(|scene| scene.iter().map(&number).collect()).collect();
    bootstrap(&numbers, statistic).scaled(factor).into()
}
