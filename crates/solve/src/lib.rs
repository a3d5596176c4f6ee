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
//! normal equations are an arrow and cost is linear in cars (`arrow.rs`). The inner loop takes four keypoints at a time
//! (`ground_rows.rs`), with AVX2 where the processor has it, to the same bits everywhere.
//!
//! From nothing: view directions, focal lengths and planes that cars agree on (`cold_start.rs`), shapes eased in stages
//! (`scene.rs`), second thoughts about single cars (`repair.rs`) and keypoints (`reclassify.rs`). From the minimum over
//! everything the camera then goes on to that of all modes of the atlas (`fine.rs`, `fine_problem.rs`), and to the maximum over
//! the camera alone (`marginal.rs`). There, and where cars are free of the plane, a car's prior is that of the body types that it
//! may have (`body_types.rs`).
//!
//! # Entry points
//! [`solve_scene`]: everything unknown. [`fit_car`]: camera and plane known. [`fit_free_car`],
//! [`solve_free_scene`]: no plane, 6-DoF poses, or the paper's soft plane terms (Eq. 4–7) with its Algorithm 1.
//! [`refine_scene`], [`scene_bound`]: from a known scene.

mod alternation;
mod arrow;
mod body_types;
mod camera_knowledge;
mod cold_start;
#[cfg(test)]
mod dual;
mod fine;
mod fit;
mod free;
mod free_problem;
mod free_residual;
mod gram_sum;
mod ground_problem;
mod ground_residual;
mod ground_rows;
mod kernel;
mod lanes;
mod lm;
mod marginal;
mod observation;
mod options;
mod reclassify;
mod refine;
mod repair;
mod scene;
mod setup;
mod solution;
mod standing_start;
mod trust;
mod up_consensus;
mod weak_perspective;

pub use fit::{CarFit, fit_car};
pub use free::{FreeCarFit, FreeSceneSolution, fit_free_car, solve_free_scene};
pub use free_problem::PlaneTerms;
pub use kernel::OutlierModel;
pub use lm::{LmOptions, LmReport, Problem, Termination, Trial, minimise};
pub use options::{CameraPrior, SceneOptions, ShapePrior};
pub use refine::{KnownScene, refine_scene, scene_bound};
pub use scene::solve_scene;
pub use solution::{CarSolution, CarView, SceneSolution, SceneStatus};
