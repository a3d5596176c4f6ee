//! Keypoints of the cars of one frame → focal length, ground plane, poses and shapes, each with its covariance.
//! Pure maths in f64: no I/O, no clock, no random numbers, no panics; the same input gives the same bits.
//!
//! # Model
//! Pinhole camera with square pixels and the principal point in the middle of the image; unknown are
//! [`CameraParams`](roadplane_base::CameraParams) `c = (log f, tilt, roll, log h)`. Car k has a shape `λ_k` (6 coefficients of
//! the atlas, prior N(0, I)) and stands on the plane with position and heading. Minimised is
//!
//! ```text
//! E = Σ_k Σ_i ½ s_i ρ(‖W_i (π(c, car_k, X_i(λ_k)) − z_i)‖²)  +  Σ_k ½ ‖λ_k‖²  +  ½ ‖c − c₀‖²_P
//! ```
//!
//! with keypoint `z_i`, its score `s_i`, whitening `W_i` from the keypoint's covariance and what the atlas leaves
//! unexplained, and an outlier model `ρ` (see [`OutlierModel`]). One car couples to another through `c` only, so the
//! normal equations are an arrow and cost is linear in cars.
//!
//! The scene is found with the atlas' first 6 modes; the camera is then that of all 12, of which what the first leave over is
//! not noise of single keypoints any more: the same problem with more modes. There, and where cars are free of the plane, a
//! car's prior is that of the body types that it may have, and a car that fits worse than the others counts less. Last, the
//! bias of the minimum is taken away.
//!
//! # Contents
//! - `linear/`: the descent ([`minimise`]), the arrow, sums of four rows at a time; knows no cars
//! - `model/`: projection and its derivatives, keypoints, outliers, priors; `latent/`: body types, trust
//! - `problem/`: cars on the plane (any number of modes) or free, as one problem; what a frame's input is made into
//! - `start/`: from nothing to places where the descent may begin; the paper's Algorithm 1
//! - `scene/`: the solves themselves, as numbered steps (`solve.rs`)
//!
//! # Entry points
//! [`solve_scene`]: everything unknown. [`fit_car`]: camera and plane known. [`fit_free_car`],
//! [`solve_free_scene`]: no plane, 6-DoF poses, or the paper's soft plane terms (Eq. 4–7) with its Algorithm 1.
//! [`refine_scene`], [`scene_bound`]: from a known scene.
//!
//! # Example
//! ```
//! use roadplane_base::ShapeAtlas;
//! use roadplane_solve::{CarView, SceneOptions, solve_scene};
//! use roadplane_synth::{SynthOptions, scene};
//!
//! let atlas = ShapeAtlas::shipped()?;
//! let truth = scene(&atlas, &SynthOptions { cars: 10, noise: 0.005, ..SynthOptions::default() }, 1);
//! let views = CarView::each(truth.keypoints());
//! let found = solve_scene(&atlas, truth.size, &views, &SceneOptions::default());
//! assert!(found.status.usable());
//! assert!((found.params.focal_px() / truth.params.focal_px()).ln().abs() < 4.0 * found.covariance[(0, 0)].sqrt());
//! # Ok::<(), roadplane_base::AtlasError>(())
//! ```

pub use roadplane_base::CameraPrior;

mod linear;
mod model;
mod options;
mod problem;
mod scene;
mod solution;
mod start;

pub use linear::lm::{LmOptions, LmReport, Problem, Termination, Trial, minimise};
pub use model::free::PlaneTerms;
pub use model::kernel::OutlierModel;
pub use options::{SceneOptions, ShapePrior, Steps, ViewErrors};
pub use scene::fit::{CarFit, fit_car};
pub use scene::free::{FreeCarFit, FreeSceneSolution, fit_free_car, solve_free_scene};
pub use scene::refine::{GivenScene, refine_scene, scene_bound};
pub use scene::solve::solve_scene;
pub use solution::{CarSolution, CarView, SceneSolution, SceneStatus};
