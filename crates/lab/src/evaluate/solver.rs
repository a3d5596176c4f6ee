//! Accuracy of the joint solver on synthetic scenes with exact truth: the tables of `roadplane-lab eval solver` and
//! `roadplane-lab eval camera-database`.
//!
//! The crate `roadplane_synth` makes the scenes from fixed seeds. Therefore all tables except measured times are the
//! same on every machine.

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
