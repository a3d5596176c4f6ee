//! Estimates focal length, ground plane, poses and shapes from the keypoints of the cars of one frame, with
//! covariances. Pure maths in f64: no I/O, no clock, no random numbers, no panics. The same input gives the same bits.
//!
//! # Model
//! The camera is a pinhole with square pixels and the principal point in the middle of the image. Its unknowns are
//! [`CameraParams`](roadplane_base::CameraParams) `c = (log f, tilt, roll, log h)`. Car k has a shape `λ_k`, which is 6
//! coefficients of the atlas with the prior N(0, I). It has a position and a heading on the plane. The cost is
//!
//! ```text
//! E = Σ_k Σ_i ½ s_i ρ(‖W_i (π(c, car_k, X_i(λ_k)) − z_i)‖²)  +  Σ_k ½ ‖λ_k‖²  +  ½ ‖c − c₀‖²_P
//! ```
//!
//! with keypoint `z_i`, its score `s_i`, and an outlier model `ρ` (see [`OutlierModel`]). The whitening `W_i` comes
//! from the keypoint's covariance and the atlas' residual. Two cars are coupled through `c` only. So the normal
//! equations have the shape of an arrow, and the computing time is linear in the number of cars.
//!
//! The scene is solved with the atlas' first 6 modes. The camera is then refined with all 12 modes, so that the
//! residual of the first modes no longer counts as noise of single keypoints. In this step, a car's prior is the
//! mixture of its likely body types, and a car that fits worse than the others gets less weight. Free cars have this
//! prior too. Last, the bias of the minimum is corrected.
//!
//! # Contents
//! - `linear/`: the descent ([`minimise`]), the arrow-shaped equations, sums of four rows at a time; independent of
//!   cars
//! - `model/`: projection and its derivatives, keypoints, outliers, priors; `latent/`: body types, trust
//! - `problem/`: the joint problem of cars on the plane (any number of modes) or free; preparation of a frame's input
//! - `start/`: the search for starts of the descent; the paper's Algorithm 1
//! - `scene/`: the solves themselves, as numbered steps (`solve.rs`)
//!
//! # Entry points
//! - [`solve_scene`]: camera, plane and cars are all unknown.
//! - [`fit_car`]: camera and plane are given.
//! - [`fit_free_car`], [`solve_free_scene`]: poses have 6 degrees of freedom. Optional soft plane terms are those of
//!   the paper (Eq. 4–7), with its Algorithm 1.
//! - [`refine_scene`], [`scene_bound`]: a scene is given.
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
