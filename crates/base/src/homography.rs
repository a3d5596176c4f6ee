//! Homographies of the picture plane: the motion of a picture between two orientations or focal lengths of a camera.

use nalgebra::{Matrix2, Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};

use crate::Similarity;

/// Least third homogeneous coordinate of a mapped point. Below it, the point is behind the camera or nearly so.
const LEAST_DEPTH: f64 = 1e-3;
/// Largest number of iterations of a singular value decomposition.
const SVD_ROUNDS: usize = 100;

/// A homography of the picture plane, px. A camera that turns or zooms about its centre maps pixels by `K₁ R K₀⁻¹`
/// (Hartley & Zisserman 2004, section 8.4). The last number of the matrix is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Homography(Matrix3<f64>);

/// The turn and the zoom of a camera between two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Focal length of the second picture, divided by that of the first.
    pub growth: f64,
    /// Rotation from the camera frame of the first picture to that of the second.
    pub rotation: Rotation3<f64>,
}

impl Homography {
    /// The homography that maps each point to itself.
    pub const IDENTITY: Self = Self(Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0));

    /// Creates a homography from its matrix. Returns `None` if it has no inverse or maps the origin to infinity.
    #[must_use]
    pub fn new(matrix: Matrix3<f64>) -> Option<Self> {
        let scaled = matrix / matrix[(2, 2)];
        (scaled.iter().all(|v| v.is_finite()) && scaled.determinant().abs() > 1e-9).then_some(Self(scaled))
    }

    /// Creates a homography from the first eight numbers of its matrix, row by row. Returns `None` if it has no inverse.
    #[must_use]
    pub fn from_numbers([a, b, c, d, e, f, g, h]: [f64; 8]) -> Option<Self> {
        Self::new(Matrix3::new(a, b, c, d, e, f, g, h, 1.0))
    }

    /// Returns the first eight numbers of the matrix, row by row.
    #[must_use]
    pub fn numbers(&self) -> [f64; 8] {
        let m = &self.0;
        [m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 0)], m[(1, 1)], m[(1, 2)], m[(2, 0)], m[(2, 1)]]
    }

    /// Returns the numbers of [`Self::numbers`], rounded as files store them. They are those of a mapping of pixels.
    #[must_use]
    pub fn rounded_numbers(&self) -> [f64; 8] {
        Self::rounded(self.numbers())
    }

    /// Rounds numbers of a mapping of pixels, or changes of them, as files store them.
    #[must_use]
    pub fn rounded(mut numbers: [f64; 8]) -> [f64; 8] {
        const DIGITS: [f64; 8] = [1e8, 1e8, 1e4, 1e8, 1e8, 1e4, 1e11, 1e11];
        // Adding zero turns a negative zero into zero.
        numbers.iter_mut().zip(DIGITS).for_each(|(n, digits)| *n = (*n * digits).round() / digits + 0.0);
        numbers
    }

    /// Returns the matrix; its last number is 1.
    #[must_use]
    pub fn matrix(&self) -> &Matrix3<f64> {
        &self.0
    }

    /// Returns the mapped point. A point that is mapped to infinity goes very far.
    #[must_use]
    pub fn apply(&self, point: &Vector2<f64>) -> Vector2<f64> {
        let mapped = self.0 * Vector3::new(point.x, point.y, 1.0);
        mapped.xy() / mapped.z.max(LEAST_DEPTH)
    }

    /// Returns the derivative of the mapped point by the point.
    #[must_use]
    pub fn jacobian(&self, point: &Vector2<f64>) -> Matrix2<f64> {
        let depth = (self.0 * Vector3::new(point.x, point.y, 1.0)).z.max(LEAST_DEPTH);
        let mapped = self.apply(point);
        let linear = self.0.fixed_view::<2, 2>(0, 0);
        let perspective = self.0.fixed_view::<1, 2>(2, 0);
        (linear - mapped * perspective) / depth
    }

    /// Returns the inverse homography.
    #[must_use]
    pub fn inverse(&self) -> Self {
        self.0.try_inverse().and_then(Self::new).unwrap_or(Self::IDENTITY)
    }

    /// Returns the homography that applies `self` first and `next` afterwards.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self::new(next.0 * self.0).unwrap_or(Self::IDENTITY)
    }

    /// Returns the same mapping in other coordinates: `to = scale · from + origin`.
    #[must_use]
    pub fn in_coordinates(&self, scale: f64, origin: Vector2<f64>) -> Self {
        let change = Matrix3::new(scale, 0.0, origin.x, 0.0, scale, origin.y, 0.0, 0.0, 1.0);
        let back = Matrix3::new(
            1.0 / scale,
            0.0,
            -origin.x / scale,
            0.0,
            1.0 / scale,
            -origin.y / scale,
            0.0,
            0.0,
            1.0,
        );
        Self::new(change * self.0 * back).unwrap_or(Self::IDENTITY)
    }

    /// Returns the root mean square displacement, px, of a 5 × 5 grid over a box.
    #[must_use]
    pub fn displacement(&self, bbox_px: &[f64; 4]) -> f64 {
        let sum: f64 = bbox_grid(bbox_px).map(|point| (self.apply(&point) - point).norm_squared()).sum();
        (sum / 25.0).sqrt()
    }

    /// Returns the similarity transform that fits the mapping of a box best.
    #[must_use]
    pub fn similarity(&self, bbox_px: &[f64; 4]) -> Similarity {
        let pairs: Vec<_> = bbox_grid(bbox_px).map(|point| (point, self.apply(&point))).collect();
        Similarity::fit(&pairs).unwrap_or(Similarity::carrying(&Vector2::zeros(), &Vector2::zeros(), 1.0))
    }

    /// Returns the turn and zoom `K_g R K⁻¹` that this homography is nearly, for a camera with this focal length and
    /// principal point, px. R is the nearest rotation (Hartley & Zisserman 2004, section 8.4). Returns `None` if there
    /// is none.
    #[must_use]
    pub fn turn(&self, focal_px: f64, centre_px: &Vector2<f64>) -> Option<Turn> {
        let (x, y) = (centre_px.x, centre_px.y);
        let rays = Matrix3::new(focal_px, 0.0, x, 0.0, focal_px, y, 0.0, 0.0, 1.0);
        let unit = 1.0 / focal_px;
        let inverse = Matrix3::new(unit, 0.0, -x * unit, 0.0, unit, -y * unit, 0.0, 0.0, 1.0);
        let turn = inverse * self.0 * rays;
        let growth =
            (0.5 * (turn.row(0).norm_squared() + turn.row(1).norm_squared())).sqrt() / turn.row(2).norm();
        let unscaled = Matrix3::from_diagonal(&Vector3::new(1.0 / growth, 1.0 / growth, 1.0)) * turn;
        let svd = unscaled.try_svd(true, true, f64::EPSILON, SVD_ROUNDS)?;
        Some(Turn { growth, rotation: Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?) })
    }

    /// Returns the homography between two others, at a share of the way: 0 gives `self`, 1 gives `other`. The numbers
    /// are interpolated, so both should be near each other.
    #[must_use]
    pub fn between(&self, other: &Self, share: f64) -> Self {
        Self::new(self.0 + (other.0 - self.0) * share).unwrap_or(*self)
    }

    /// Fits a homography to weighted pairs (point, mapped point) by linear least squares.
    ///
    /// Coordinates should be of order 1. The algebraic error `|A p + t − q (1 + g·p)|` is minimised; for small
    /// perspective it is the distance. `prior` has a homography and the information of each of its eight numbers.
    /// Returns the homography and the inverse of the normal matrix, or `None` if the points do not determine it.
    #[must_use]
    pub fn fit(
        pairs: impl Iterator<Item = (Vector2<f64>, Vector2<f64>, f64)>,
        prior: Option<(&Self, &SVector<f64, 8>)>,
    ) -> Option<(Self, SMatrix<f64, 8, 8>)> {
        let (mut normal, mut right) = (SMatrix::<f64, 8, 8>::zeros(), SVector::<f64, 8>::zeros());
        if let Some((mean, information)) = prior {
            normal += SMatrix::from_diagonal(information);
            right += SVector::from(mean.numbers()).component_mul(information);
        }
        for (p, q, weight) in pairs {
            for row in [
                (SVector::from([p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y]), q.x),
                (SVector::from([0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y]), q.y),
            ] {
                normal += row.0 * row.0.transpose() * weight;
                right += row.0 * row.1 * weight;
            }
        }
        let inverse = normal.cholesky()?.inverse();
        Some((Self::from_numbers((inverse * right).into())?, inverse))
    }

    /// Returns the derivative of a mapped point by the eight numbers of the matrix.
    #[must_use]
    pub fn derivative_by_numbers(&self, p: &Vector2<f64>) -> SMatrix<f64, 2, 8> {
        let depth = (self.0 * Vector3::new(p.x, p.y, 1.0)).z.max(LEAST_DEPTH);
        let q = self.apply(p);
        SMatrix::<f64, 2, 8>::from_row_slice(&[
            p.x,
            p.y,
            1.0,
            0.0,
            0.0,
            0.0,
            -q.x * p.x,
            -q.x * p.y, //
            0.0,
            0.0,
            0.0,
            p.x,
            p.y,
            1.0,
            -q.y * p.x,
            -q.y * p.y,
        ]) / depth
    }
}

impl From<Similarity> for Homography {
    fn from(similarity: Similarity) -> Self {
        let shift = similarity.apply(&Vector2::zeros());
        let column = |axis: Vector2<f64>| similarity.apply(&axis) - shift;
        let (x, y) = (column(Vector2::x()), column(Vector2::y()));
        Self(Matrix3::new(x.x, y.x, shift.x, x.y, y.y, shift.y, 0.0, 0.0, 1.0))
    }
}

/// Iterates over a 5 × 5 grid of points over a box, row by row.
pub fn bbox_grid([x0, y0, x1, y1]: &[f64; 4]) -> impl Iterator<Item = Vector2<f64>> + use<> {
    let [x0, y0, x1, y1] = [*x0, *y0, *x1, *y1];
    (0..25).map(move |i| {
        let (u, v) = (f64::from(i % 5) / 4.0, f64::from(i / 5) / 4.0);
        Vector2::new(x0 + u * (x1 - x0), y0 + v * (y1 - y0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    /// Returns K R K⁻¹ with the principal point at the origin.
    fn turned(focal: f64, pan: f64, tilt: f64, roll: f64) -> Homography {
        let k = Matrix3::from_diagonal(&Vector3::new(focal, focal, 1.0));
        let rotation = Rotation3::from_euler_angles(tilt, pan, roll);
        Homography::new(k * rotation.matrix() * k.try_inverse().unwrap()).unwrap()
    }

    proptest! {
        #[test]
        fn a_fit_finds_the_homography(pan in -0.3f64..0.3, tilt in -0.2f64..0.2, roll in -0.1f64..0.1) {
            let truth = turned(1.5, pan, tilt, roll);
            let pairs = bbox_grid(&[-1.0, -0.6, 1.0, 0.6]).map(|p| (p, truth.apply(&p), 1.0));
            let (found, _) = Homography::fit(pairs, None).unwrap();
            for (a, b) in found.numbers().into_iter().zip(truth.numbers()) {
                prop_assert!((a - b).abs() < 1e-9);
            }
        }

        #[test]
        fn a_turn_is_found_again(pan in -0.5f64..0.5, tilt in -0.3f64..0.3, growth in 0.5f64..2.0) {
            let (focal, centre) = (900.0, Vector2::new(639.5, 359.5));
            let k = |focal: f64| Matrix3::new(focal, 0.0, centre.x, 0.0, focal, centre.y, 0.0, 0.0, 1.0);
            let rotation = Rotation3::from_euler_angles(tilt, pan, 0.1);
            let picture = k(growth * focal) * rotation.matrix() * k(focal).try_inverse().unwrap();
            let turn = Homography::new(picture).unwrap().turn(focal, &centre).unwrap();
            prop_assert!((turn.growth - growth).abs() < 1e-9);
            prop_assert!((turn.rotation.matrix() - rotation.matrix()).norm() < 1e-9);
        }

        #[test]
        fn derivatives_and_inverse_agree_with_the_mapping(x in -300.0f64..300.0, y in -200.0f64..200.0) {
            let h = turned(600.0, 0.1, -0.05, 0.03);
            let p = Vector2::new(x, y);
            prop_assert!((h.inverse().apply(&h.apply(&p)) - p).norm() < 1e-8);
            for axis in [Vector2::x(), Vector2::y()] {
                let step = 1e-4;
                let numeric = (h.apply(&(p + step * axis)) - h.apply(&(p - step * axis))) / (2.0 * step);
                prop_assert!((numeric - h.jacobian(&p) * axis).norm() < 1e-6);
            }
            let numbers = h.numbers();
            for i in 0..8 {
                let step = if i >= 6 { 1e-8 } else { 1e-4 };
                let changed = |by: f64| {
                    let mut numbers = numbers;
                    numbers[i] += by;
                    Homography::from_numbers(numbers).unwrap().apply(&p)
                };
                let numeric = (changed(step) - changed(-step)) / (2.0 * step);
                let exact = h.derivative_by_numbers(&p).column(i).into_owned();
                prop_assert!((numeric - exact).norm() < 1e-4 * (1.0 + exact.norm()), "{i}");
            }
        }
    }

    #[test]
    fn other_coordinates_give_the_same_mapping() {
        let h = turned(300.0, 0.05, 0.02, 0.01);
        let origin = Vector2::new(640.0, 360.0);
        let p = Vector2::new(50.0, -70.0);
        let there = h.in_coordinates(4.0, origin).apply(&(4.0 * p + origin));
        assert!((there - (4.0 * h.apply(&p) + origin)).norm() < 1e-9);
        assert!(h.displacement(&[-320.0, -180.0, 320.0, 180.0]) > 10.0);
        let halfway = Homography::IDENTITY.between(&h, 0.5).apply(&p);
        assert!((halfway - 0.5 * (p + h.apply(&p))).norm() < 0.5);
        assert!((h.similarity(&[-9.0, -9.0, 9.0, 9.0]).turn() - 0.01).abs() < 2e-3);
    }
}
