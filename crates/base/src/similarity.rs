//! Similarity transforms of the plane.

use nalgebra::{Matrix2, Vector2};

/// A similarity transform of the plane: `moved = m · point + shift`. The matrix m is a rotation times a scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    m: Matrix2<f64>,
    shift: Vector2<f64>,
}

impl Similarity {
    /// Creates a transform without rotation that scales by `scale` and maps the point `from` to the point `to`.
    #[must_use]
    pub fn carrying(from: &Vector2<f64>, to: &Vector2<f64>, scale: f64) -> Self {
        let m = Matrix2::identity() * scale;
        Self { m, shift: to - m * from }
    }

    /// Fits a transform to pairs (point, moved point) by least squares, in closed form (Umeyama 1991).
    ///
    /// If there is only one pair, or all points coincide, the result is a pure shift. Returns `None` if `pairs` is
    /// empty.
    #[must_use]
    pub fn fit(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Self> {
        Self::fit_weighted(pairs, |_| 1.0)
    }

    /// Fits a transform like [`Self::fit`], with a weight above 0 for each pair. The weight depends on the pair's number.
    #[must_use]
    pub fn fit_weighted(
        pairs: &[(Vector2<f64>, Vector2<f64>)],
        weight: impl Fn(usize) -> f64,
    ) -> Option<Self> {
        if pairs.is_empty() {
            return None;
        }
        let weights = || (0..pairs.len()).map(&weight);
        let n: f64 = weights().sum();
        let from = pairs.iter().zip(weights()).map(|(p, w)| p.0 * w).sum::<Vector2<f64>>() / n;
        let to = pairs.iter().zip(weights()).map(|(p, w)| p.1 * w).sum::<Vector2<f64>>() / n;
        let (mut dot, mut cross, mut spread) = (0.0, 0.0, 0.0);
        for (i, (a, b)) in pairs.iter().enumerate() {
            let (a, b, weight) = (a - from, b - to, weight(i));
            dot += weight * a.dot(&b);
            cross += weight * (a.x * b.y - a.y * b.x);
            spread += weight * a.norm_squared();
        }
        let (c, s) = if spread > 1e-9 { (dot / spread, cross / spread) } else { (1.0, 0.0) };
        let m = Matrix2::new(c, -s, s, c);
        Some(Self { m, shift: to - m * from })
    }

    /// Returns the transformed point.
    #[must_use]
    pub fn apply(&self, point: &Vector2<f64>) -> Vector2<f64> {
        self.m * point + self.shift
    }

    /// Returns the rotation angle, rad. It is positive from the x axis towards the y axis.
    #[must_use]
    pub fn turn(&self) -> f64 {
        self.m[(1, 0)].atan2(self.m[(0, 0)])
    }

    /// Returns the logarithm of the scale.
    #[must_use]
    pub fn log_scale(&self) -> f64 {
        self.m.determinant().max(1e-12).ln() / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_similarity_is_found_again(scale in 0.5f64..2.0, angle in -1.0f64..1.0, x in -99.0f64..99.0, y in -99.0f64..99.0) {
            let (s, c) = angle.sin_cos();
            let m = Matrix2::new(c, -s, s, c) * scale;
            let points = [[0.0, 0.0], [100.0, 10.0], [-30.0, 50.0]].map(Vector2::from);
            let pairs = points.map(|p| (p, m * p + Vector2::new(x, y)));
            let fitted = Similarity::fit(&pairs).unwrap();
            for (a, b) in pairs {
                prop_assert!((fitted.apply(&a) - b).norm() < 1e-9);
            }
            prop_assert!((fitted.log_scale() - scale.ln()).abs() < 1e-9);
        }
    }
}
