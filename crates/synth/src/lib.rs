//! Synthetic scenes with truth: a random camera above a plane, cars from the atlas on it, their keypoints with noise,
//! outliers and wholly wrong cars; and clips in which cars drive, turn, halt, reverse and park. Geometry only; the renderer
//! is a script. The same seed gives the same scene everywhere.
//!
//! # Contents
//! - scenes: [`scene`] (`scene.rs`), what is measured of them (`keypoints.rs`), cars that no atlas made ([`CarModel`])
//! - clips: [`clip_item`] (`clip.rs`), manoeuvres (`traffic.rs`), how cars drive ([`trajectory`])
//! - for tests of others: [`standing`] (a row of a result), [`BenchScene`], [`Rng`]
//!
//! # Example
//! ```
//! use roadplane_base::ShapeAtlas;
//! use roadplane_synth::{SynthOptions, scene};
//!
//! let atlas = ShapeAtlas::shipped()?;
//! let truth = scene(&atlas, &SynthOptions { cars: 5, noise: 0.01, ..SynthOptions::default() }, 7);
//! assert_eq!(truth.cars.len(), 5);
//! # Ok::<(), roadplane_base::AtlasError>(())
//! ```

mod bench;
mod clip;
mod item;
mod keypoints;
mod models;
mod rng;
mod row;
mod scene;
mod traffic;
pub mod trajectory;
mod truth;

pub use bench::{BenchScene, random_camera};
pub use clip::{ClipOptions, clip_item};
pub use item::{Item, ItemCar, Sighting, still_item};
pub use models::{CarModel, draw_shape};
pub use rng::Rng;
pub use row::standing;
pub use scene::scene;
pub use truth::{CarTruth, Layout, SceneTruth, SynthOptions, Wrong};
