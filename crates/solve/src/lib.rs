//! Estimates the focal length, the ground plane, and the poses and shapes of cars from their keypoints in one frame.
//!
//! Every estimate has a covariance. The crate is pure maths in f64: no I/O, no clock, no random numbers, no panics. The
//! same input gives the same bits.
//!
//! # Model
//! The camera is a pinhole with square pixels and the principal point in the middle of the image. Its unknowns are
//! [`CameraParams`](roadplane_base::CameraParams) `c = (log f, tilt, roll, log h)`: focal length f (px), two angles
//! (rad) and height h above the ground (m).
//!
//! Car shapes come from the shape atlas, a linear model: a mean car plus a weighted sum of modes, which are typical
//! deviations from the mean car. The shape `λ_k` of car k is a vector of 6 coefficients with the prior N(0, I). Each
//! car also has a position and a heading on the ground plane. The cost is
//!
//! ```text
//! E = Σ_k Σ_i ½ s_i ρ(‖W_i (π(c, car_k, X_i(λ_k)) − z_i)‖²)  +  Σ_k ½ ‖λ_k‖²  +  ½ ‖c − c₀‖²_P
//! ```
//!
//! `X_i(λ)` is the i-th keypoint of a car of shape λ, and `π` projects it into the image. The measured keypoint is
//! `z_i`, with score `s_i`. `ρ` is the robust loss of the [`OutlierModel`]. `W_i` whitens the reprojection error. It
//! accounts for the keypoint's covariance and for the part of the shape that the modes do not explain. The camera's
//! prior has mean `c₀` and inverse covariance `P`.
//!
//! Two cars are coupled through `c` only. So the normal equations have the shape of an arrow, and the computing time is
//! linear in the number of cars.
//!
//! The scene is first solved with 6 modes of the atlas. In this solve, the 6 remaining modes count as independent noise
//! of each keypoint. Then the camera is refined with all 12 modes. In the refinement, the shape prior of a car is the
//! mixture of its likely body types. Cars that fit worse than most cars get less weight. Finally, the bias of the
//! estimated camera is corrected.
//!
//! # Contents
//! - `linear/`: general least squares: the descent ([`minimise`]) and the arrow-shaped normal equations
//! - `model/`: projection and its derivatives, keypoints, outliers, priors, body types, weights of cars
//! - `problem/`: the joint least-squares problem of all cars of a frame, and the preparation of its input
//! - `start/`: the search for start values of the descent
//! - `scene/`: the complete solves; `solve.rs` lists their steps
//!
//! # Entry points
//! - [`solve_scene`]: camera, plane and cars are all unknown.
//! - [`fit_car`]: camera and plane are given.
//! - [`fit_free_car`], [`solve_free_scene`]: poses have 6 degrees of freedom. The second function implements the paper
//!   *Car Pose in Context* (Eq. 4–7 and Algorithm 1), which this crate extends.
//! - [`refine_scene`], [`scene_bound`]: start values of camera, poses and shapes are given.
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
pub use solution::{CarSolution, CarView, PlaneEvidence, SceneSolution, SceneStatus};
