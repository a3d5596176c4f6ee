//! Scores predicted keypoints on labelled images: reads the labels, measures the errors, and makes the tables.

mod labels;
mod measure;
mod predict;
mod tables;

pub use labels::{Label, LabelledCar, LabelledImage};
pub use measure::{CarErrors, Confusion, PointError, auc, confusion, measure};
pub use predict::predict;
pub use tables::{keypoint_tables, worst_first};
