//! Accuracy of the joint solver on scenes with exact truth: the tables of `roadplane-lab eval solver` and
//! `camera-database`.
//!
//! Scenes are drawn by `roadplane_synth` from fixed seeds. So the tables are the same on every machine, except for
//! times.

mod ablation;
mod camera_database;
mod exact;
mod fusion;
mod layers;
mod scenes;
mod speed;
mod statistics;

pub use ablation::ablation_tables;
pub use camera_database::camera_database_tables;
pub use exact::exact_table;
pub use fusion::fusion_table;
pub use layers::{ReferencePicture, layers_tables, synthetic_pictures};
pub use speed::{SpeedPoint, speed, speed_plot, speed_table};
pub use statistics::statistics_tables;
