//! The convex relaxation that gives the initial values of the descent. It uses the mean shape alone.
//!
//! The method is that of Zhou et al. 2015, "3D shape estimation from 2D landmarks: a convex relaxation approach", Eq.
//! 9–11.
//!
//! The unknown is the 2 × 3 matrix `M = s R̄`: a scale s times two orthonormal rows R̄. For a fixed s, the convex hull
//! of such matrices is a ball of the spectral norm. So the relaxed M may be any 2 × 3 matrix, with a penalty on its
//! spectral norm:
//!
//! ```text
//! min_M ½ ‖(W − M B) D^½‖² + α ‖M‖₂          W, B centred
//! ```
//!
//! W are the image points, B the points of the mean shape, and D the confidences. α is the weight of the penalty.
//!
//! ADMM solves this problem. Its second step is the proximal operator of the spectral norm, in closed form.

use nalgebra::{Matrix2x3, Matrix3, Vector2};

/// Weight α of the penalty, as a share of the least α for which M = 0 is the solution.
const ALPHA_SHARE: f64 = 0.02;
/// Largest number of iterations of ADMM.
const MAX_ITERATIONS: usize = 500;
/// Relative change of M below which the iteration ends.
const TOLERANCE: f64 = 1e-8;

/// Returns the solution M of the relaxed problem, from `square = B D Bᵀ` and `cross = W D Bᵀ`. Returns `None` if M is
/// not determined.
pub(super) fn relaxed_motion(square: &Matrix3<f64>, cross: &Matrix2x3<f64>) -> Option<Matrix2x3<f64>> {
    // M = 0 is the solution if α is at least the dual norm of the cross term. The dual norm is the sum of the singular
    // values.
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

/// Returns the matrix M that minimises `½ ‖M − Q‖² + τ ‖M‖₂`. Its singular values are those of Q, minus their
/// projection on the ℓ₁ ball of radius τ.
fn proximal(q: &Matrix2x3<f64>, tau: f64) -> Option<Matrix2x3<f64>> {
    let svd = checked_svd(q)?;
    let (u, v_t, sigma) = (svd.u?, svd.v_t?, svd.singular_values);
    let (most, least) = (sigma.max(), sigma.min());
    // Singular values above θ are reduced to θ: either both values, or the larger one alone.
    let both = (most + least - tau) / 2.0;
    let theta = if both < least { both } else { most - tau };
    Some(u * nalgebra::Matrix2::from_diagonal(&sigma.map(|s| s.min(theta.max(0.0)))) * v_t)
}

/// Returns the 2 × 3 matrix with orthonormal rows that is nearest to M, and the mean of M's singular values. Returns
/// `None` if the rows of M are almost parallel.
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
        // If the points spread equally in all directions, the penalty only shrinks M.
        let square = Matrix3::identity() * 10.0;
        let rows = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 2.0);
        let truth = rows.matrix().fixed_view::<2, 3>(0, 0) * 0.05;
        let m = relaxed_motion(&square, &(truth * 10.0)).unwrap();
        let (found, scale) = nearest_scaled_rows(&m).unwrap();
        assert!((found - truth / 0.05).norm() < 1e-6);
        assert!(scale < 0.05 && scale > 0.045, "{scale}");
    }
}
