//! From the camera of the most likely scene to the most likely camera.
//!
//! Cars are many and know little each, so the joint minimum is biased however many there are (Neyman and Scott 1948): it shrinks
//! the world, since in a smaller one all shape coefficients at once come nearer to the mean, and it turns views so that cars
//! fit more closely. Integrated over shapes and poses by Laplace's method, what the cars say of the camera has one more term,
//!
//! ```text
//! L(c) = ½ Σ_k log det H_k(c)          H_k: Hessian of car k's shape and pose, along the valley of the minimum
//! δc = −Σ_c ∂L/∂c                      Σ_c: covariance of the camera
//! ```
//!
//! The measure is flat in the anchor's pixel, heading and prior-whitened shape, which does not depend on the scale of the world.
//! The shift is a fraction of a sd of one frame, but the same in every frame: it would not average out. Source: Tierney and
//! Kadane 1986, J. Am. Stat. Assoc. 81.

use nalgebra::{Matrix4, Vector4};

use crate::problem::cars::GroundProblem;

/// Step of the forward difference, in log units and rad.
const STEP: f64 = 1e-5;
/// Differentiated: log focal, tilt, log height. By symmetry roll hardly matters.
const BY: [usize; 3] = [0, 1, 3];

/// Change of the camera from the minimum, whose camera has this `covariance` (zero where fixed). At most one sd: where it would
/// be more, Laplace's method is no longer good. After `covariances`. `None` when a car cannot be evaluated.
pub(crate) fn change<const M: usize>(
    problem: &mut GroundProblem<'_, M>,
    covariance: &Matrix4<f64>,
) -> Option<Vector4<f64>> {
    let here = problem.half_log_determinant()?;
    let mut gradient = Vector4::zeros();
    for i in BY.into_iter().filter(|i| covariance[(*i, *i)] > 0.0) {
        let mut step = Vector4::zeros();
        step[i] = STEP;
        gradient[i] = (problem.half_log_determinant_at(&step)? - here) / STEP;
    }
    let change = -(covariance * gradient);
    // changeᵀ Σ⁻¹ change
    let squared_sds = -change.dot(&gradient);
    let change = change / squared_sds.max(1.0).sqrt();
    change.iter().all(|v| v.is_finite()).then_some(change)
}
