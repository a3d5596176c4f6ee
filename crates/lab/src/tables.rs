//! Tables and plots of scores, with one row per system. Confidence intervals come from resampling the scenes.

use roadplane_tables::{Cell, bootstrap};

mod classes;
mod poses;
mod tracks;

pub use classes::classes_table;
pub use poses::{add_plot, add_table, camera_table, steps_table, viewpoint_plot, viewpoint_table};
pub use tracks::{
    boxes_table, calibration_table, motion_table, position_plot, position_table, tracking_table,
};

/// The name of a system, and the system's scores: one list for each scene.
pub type Scored<'a, T> = (&'a str, &'a [Vec<T>]);

/// Returns a table cell: the `statistic` of the `number` of every score, multiplied by `factor`.
///
/// The cell includes a 95 % interval from resampling the scenes.
fn cell<T>(
    scenes: &[Vec<T>],
    number: impl Fn(&T) -> f64,
    statistic: impl Fn(&[f64]) -> f64,
    factor: f64,
) -> Cell {
    let numbers: Vec<Vec<f64>> = scenes.iter().map(|scene| scene.iter().map(&number).collect()).collect();
    bootstrap(&numbers, statistic).scaled(factor).into()
}
