//! The convex relaxation that starts the descent (Zhou et al. 2015, "3D shape estimation from 2D landmarks: a convex
//! relaxation approach", Eq. 9–11, with the mean shape alone).
//!
//! `M = s R̄` is a scaled pair of orthonormal rows. The convex hull of such pairs is a ball of the spectral norm. So M
//! may be any 2 × 3 matrix, with a penalty on its spectral norm:
//!
//! ```text
//! min_M ½ ‖(W − M B) D^½‖² + α ‖M‖₂          W, B centred
//! ```
//!
//! ADMM solves it. Its second step is the proximal operator of the spectral norm, in closed form.

use nalgebra::{Matrix2x3, Matrix3, Vector2};

/// α as a share of the value at which M = 0 becomes the solution.
const ALPHA_SHARE: f64 = 0.02;
/// Most iterations of ADMM.
const MAX_ITERATIONS: usize = 500;
/// The iteration ends when the relative change of M is smaller.
const TOLERANCE: f64 = 1e-8;

/// Returns M from `square = B D Bᵀ` and `cross = W D Bᵀ`; `None` if they do not determine it.
pub(super) fn relaxed_motion(square: &Matrix3<f64>, cross: &Matrix2x3<f64>) -> Option<Matrix2x3<f64>> {
    // M = 0 is the solution from α = the dual norm of the cross term on, which is the sum of its singular values.
    let alpha = ALPHA_SHARE * singular_values(cross)?.sum();
    let penalty = square.trace() / 3.0;
    let inverse = (square + Matrix3::identity() * penalty).try_inverse()?;
    let mut z = Matrix2x3::zeros();
    let mut dual = Matrix2x3::zeros();
    for _ in 0..MAX_ITERATIONS {
        let m = (cross + (z - dual) * penalty) * inverse;
        let next = proximal(&(m + dual), alpha / penalty)?;
        dual += m - next;
        let change = (next - z).norm() + (m - next).norm();
        z = next;
        if change <= TOLERANCE * z.norm() {
            break;
        }
    }
    (z.norm() > 0.0).then_some(z)
}

/// Returns `argmin_M ½ ‖M − Q‖² + τ ‖M‖₂`: singular values minus their projection on the ℓ₁ ball of radius τ.
fn proximal(q: &Matrix2x3<f64>, tau: f64) -> Option<Matrix2x3<f64>> {
    let svd = checked_svd(q)?;
    let (u, v_t, sigma) = (svd.u?, svd.v_t?, svd.singular_values);
    let (most, least) = (sigma.max(), sigma.min());
    // The projection takes the part above θ, of both values or of the larger one alone.
    let both = (most + least - tau) / 2.0;
    let theta = if both < least { both } else { most - tau };
    Some(u * nalgebra::Matrix2::from_diagonal(&sigma.map(|s| s.min(theta.max(0.0)))) * v_t)
}

/// Returns the 2 × 3 pair of orthonormal rows nearest to M, and the mean of M's singular values.
pub(super) fn nearest_scaled_rows(m: &Matrix2x3<f64>) -> Option<(Matrix2x3<f64>, f64)> {
    let svd = checked_svd(m)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let scale = svd.singular_values.mean();
    (svd.singular_values.min() > 1e-9 * scale).then(|| (u * v_t, scale))
}

fn singular_values(m: &Matrix2x3<f64>) -> Option<Vector2<f64>> {
    checked_svd(m).map(|svd| svd.singular_values)
}

type Svd = nalgebra::SVD<f64, nalgebra::U2, nalgebra::U3>;

fn checked_svd(m: &Matrix2x3<f64>) -> Option<Svd> {
    // The library's iteration may not end on values that are not finite.
    m.iter().all(|v| v.is_finite()).then(|| m.try_svd(true, true, f64::EPSILON, 200)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_proximal_point_is_a_minimum() {
        for (q, tau) in [
            (Matrix2x3::new(3.0, 0.5, -0.2, 0.1, 1.0, 0.7), 0.4),
            (Matrix2x3::new(3.0, 0.5, -0.2, 0.1, 1.0, 0.7), 3.0),
            (Matrix2x3::new(0.1, 0.0, 0.0, 0.0, 0.05, 0.0), 1.0),
        ] {
            let cost =
                |m: &Matrix2x3<f64>| 0.5 * (m - q).norm_squared() + tau * singular_values(m).unwrap().max();
            let best = proximal(&q, tau).unwrap();
            for i in 0..6 {
                for step in [-1e-3, 1e-3] {
                    let mut other = best;
                    other[i] += step;
                    assert!(cost(&other) >= cost(&best) - 1e-12, "{q} {tau} entry {i}");
                }
            }
        }
    }

    #[test]
    fn scaled_rows_survive_the_relaxation() {
        // With points spread alike in all directions the penalty only shortens M.
        let square = Matrix3::identity() * 10.0;
        let rows = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 2.0);
        let truth = rows.matrix().fixed_view::<2, 3>(0, 0) * 0.05;
        let m = relaxed_motion(&square, &(truth * 10.0)).unwrap();
        let (found, scale) = nearest_scaled_rows(&m).unwrap();
        assert!((found - truth / 0.05).norm() < 1e-6);
        assert!(scale < 0.05 && scale > 0.045, "{scale}");
    }
}
