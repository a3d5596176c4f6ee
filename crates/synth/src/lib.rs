//! Synthetic scenes and clips with ground truth.
//!
//! A scene has a random camera above a ground plane, and cars with shapes from the shape atlas. The cars' keypoints
//! have noise and outliers, and some cars have only wrong keypoints. In a clip, cars drive, turn, halt, reverse and
//! park.
//!
//! This crate creates geometry only. A script renders the pictures. The same seed gives the same scene on every
//! machine.
//!
//! # Contents
//! - scenes: [`scene`] (`scene.rs`), measured keypoints (`keypoints.rs`), cars that are not in the atlas ([`CarModel`])
//! - clips: [`clip_item`] (`clip.rs`), manoeuvres (`traffic.rs`), trajectories of cars ([`trajectory`])
//! - for tests of other crates: [`stationary_row`] (a row of a result), [`BenchScene`], [`Rng`]
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
pub use item::{CarInFrame, Item, ItemCar, still_item};
pub use models::{CarModel, draw_shape};
pub use rng::Rng;
pub use row::stationary_row;
pub use scene::scene;
pub use truth::{CarTruth, Layout, SceneTruth, SynthOptions, Wrong};
