//! How good the joint solver is on scenes with exact truth: the tables of `roadplane eval solver`.
//!
//! Scenes are drawn by `roadplane_synth` from fixed seeds, so the tables are the same everywhere, times aside.

mod ablation;
mod exact;
mod fusion;
mod layers;
mod remembered;
mod scenes;
mod speed;
mod statistics;

pub use ablation::ablation_tables;
pub use exact::exact_table;
pub use fusion::fusion_table;
pub use layers::{ReferencePicture, layers_tables, synthetic_pictures};
pub use remembered::remembered_tables;
pub use speed::{SpeedPoint, speed, speed_plot, speed_table};
pub use statistics::statistics_tables;
