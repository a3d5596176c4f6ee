//! Synthetic scenes with truth: a random camera above a plane, cars from the atlas on it, their keypoints with noise,
//! outliers and wholly wrong cars; and clips in which cars drive, turn, halt, reverse and park. Geometry only; the renderer
//! is a script. The same seed gives the same scene everywhere.

mod bench;
mod clip;
mod item;
mod keypoints;
mod models;
mod rng;
mod scene;
mod traffic;
pub mod trajectory;

pub use bench::{BenchScene, random_camera};
pub use clip::{ClipOptions, clip_item};
pub use item::{Item, ItemCar, Sighting, still_item};
pub use models::{CarModel, draw_shape};
pub use rng::Rng;
pub use scene::{CarTruth, Layout, SceneTruth, SynthOptions, Wrong, scene};
