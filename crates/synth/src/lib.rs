//! Synthetic scenes with truth: a random camera above a plane, cars from the atlas on it, their keypoints with noise,
//! outliers and wholly wrong cars. Geometry only; the renderer is a script. The same seed gives the same scene everywhere.

mod keypoints;
mod models;
mod rng;
mod scene;

pub use models::CarModel;
pub use rng::Rng;
pub use scene::{CarTruth, Layout, SceneTruth, SynthOptions, Wrong, scene};
