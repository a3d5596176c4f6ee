//! Search for possible view directions of a car when the camera is unknown, under scaled orthographic projection.
//!
//! The view direction of a distant car has the azimuth α and the elevation ε. The car's image also has a rotation ρ, a
//! scale of s px/m and a shift t. Pixels z_i and projected keypoints m_i are written as complex numbers:
//!
//! ```text
//! z_i = a m_i(α, ε) + t,   a = s e^{iρ},   m_i: first two components of R(ε) Rz(α) X_i
//! ```
//!
//! X_i is the i-th keypoint of the mean car. For each (α, ε) of a grid, linear least squares gives the best a and t in
//! closed form (Horn 1987, in the plane). The whole grid is searched, so no start value is needed.
//!
//! The cost can have several minima. Front and back of a car can be confused. A nearly flat set of keypoints can also
//! be mirrored in depth. The search returns all these minima. The focal length is not needed, because it only scales
//! the car's distance (paper *Car Pose in Context*, §4.2).

use nalgebra::{Complex, Matrix3, Vector2, Vector3};
use roadplane_base::KEYPOINTS;

use crate::model::observation::Observation;

/// Number of azimuths in the grid.
const AZIMUTHS: usize = 24;
/// Elevations in the grid: angles between the line of sight and the ground, degrees.
const ELEVATIONS: [f64; 7] = [3.0, 10.0, 19.0, 30.0, 43.0, 58.0, 78.0];
/// Sd of a keypoint due to the car's unknown shape, m. Its variance is added to that of the measurement.
const SHAPE_SD_M: f64 = 0.12;
/// Upper limit of the cost of one keypoint, which makes the cost robust to outliers.
const CAP: f64 = 9.0;

/// A possible view direction of a car with the car's scale and position in the image, under scaled orthography.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Appearance {
    /// Cost of the fit, with an upper limit per keypoint.
    pub cost: f64,
    /// Rotation from the car frame to a frame whose z axis is the line of sight to the car.
    pub ray_from_car: Matrix3<f64>,
    /// Scale of the car's image, px per m.
    pub scale: f64,
    /// Image of the car's origin, px from the principal point.
    pub origin: Vector2<f64>,
}

/// A grid of view directions, as rotations from the car frame.
pub(crate) struct DirectionGrid {
    rotations: Vec<Matrix3<f64>>,
    /// First two rows of each rotation.
    rows: Vec<[Vector3<f64>; 2]>,
}

impl Appearance {
    /// Returns the rotation from the car frame to the frame of a camera with this focal length, px.
    pub fn camera_from_car(&self, focal_px: f64) -> Matrix3<f64> {
        camera_from_ray(&self.origin, focal_px) * self.ray_from_car
    }
}

/// Returns the rotation of smallest angle that maps the optical axis to the viewing ray of a pixel.
fn camera_from_ray(pixel: &Vector2<f64>, focal_px: f64) -> Matrix3<f64> {
    let ray = Vector3::new(pixel.x, pixel.y, focal_px) / (pixel.norm_squared() + focal_px * focal_px).sqrt();
    let axis = Vector3::new(-ray.y, ray.x, 0.0);
    // Rodrigues' formula for two unit vectors at the angle θ: R = I cosθ + [axis]× + axis axisᵀ / (1 + cosθ).
    Matrix3::identity() * ray.z + axis.cross_matrix() + axis * axis.transpose() / (1.0 + ray.z)
}

impl DirectionGrid {
    pub fn new() -> Self {
        let mut rows = Vec::new();
        let mut rotations = Vec::new();
        for elevation in ELEVATIONS.map(f64::to_radians) {
            let (sin_e, cos_e) = elevation.sin_cos();
            for a in 0..AZIMUTHS {
                let (sin_a, cos_a) = (std::f64::consts::TAU * a as f64 / AZIMUTHS as f64).sin_cos();
                let tilt = Matrix3::new(1.0, 0.0, 0.0, 0.0, -sin_e, -cos_e, 0.0, cos_e, -sin_e);
                let turn = Matrix3::new(cos_a, -sin_a, 0.0, sin_a, cos_a, 0.0, 0.0, 0.0, 1.0);
                let r = tilt * turn;
                rows.push([r.row(0).transpose(), r.row(1).transpose()]);
                rotations.push(r);
            }
        }
        Self { rotations, rows }
    }

    /// Returns up to `most` local minima of the cost over the grid, lowest cost first.
    pub fn appearances(
        &self,
        points_in_car: &[Vector3<f64>; KEYPOINTS],
        observations: &[Observation],
        most: usize,
    ) -> Vec<Appearance> {
        let fits: Vec<Option<Appearance>> =
            (0..self.rows.len()).map(|d| self.fit(d, points_in_car, observations)).collect();
        let cost = |e: usize, a: usize| fits[e * AZIMUTHS + a % AZIMUTHS].map_or(f64::INFINITY, |f| f.cost);
        let mut minima = Vec::new();
        for e in 0..ELEVATIONS.len() {
            for a in 0..AZIMUTHS {
                let Some(here) = fits[e * AZIMUTHS + a] else { continue };
                let sideways = cost(e, a + AZIMUTHS - 1).min(cost(e, a + 1));
                let below = if e > 0 { cost(e - 1, a) } else { f64::INFINITY };
                let above = if e + 1 < ELEVATIONS.len() { cost(e + 1, a) } else { f64::INFINITY };
                if here.cost <= sideways.min(below).min(above) {
                    minima.push(here);
                }
            }
        }
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        minima.truncate(most);
        minima
    }

    /// Fits rotation in the image, scale and shift for one view direction.
    ///
    /// The fit is linear least squares, done twice. The second fit gives less weight to outliers of the first.
    fn fit(
        &self,
        direction: usize,
        points_in_car: &[Vector3<f64>; KEYPOINTS],
        observations: &[Observation],
    ) -> Option<Appearance> {
        let rows = &self.rows[direction];
        let project = |o: &Observation| {
            let p = &points_in_car[o.index];
            Complex::new(rows[0].dot(p), rows[1].dot(p))
        };
        let pixel = |o: &Observation| Complex::new(o.pixel.x, o.pixel.y);
        let off = |o: &Observation, a: Complex<f64>, t: Complex<f64>| {
            let variance = SHAPE_SD_M * SHAPE_SD_M * a.norm_sqr() + 0.5 * o.covariance.trace();
            (a * project(o) + t - pixel(o)).norm_sqr() / variance
        };
        let mut similarity: Option<(Complex<f64>, Complex<f64>)> = None;
        for _ in 0..2 {
            let mut sums = Sums::default();
            for o in observations {
                let damping = similarity.map_or(1.0, |(a, t)| 1.0 + off(o, a, t) / 4.0);
                sums.add(o.weight / (damping * damping), project(o), pixel(o));
            }
            similarity = Some(sums.solve()?);
        }
        let (a, t) = similarity?;
        let scale = a.norm();
        let cost: f64 = observations.iter().map(|o| 0.5 * o.weight * off(o, a, t).min(CAP)).sum();
        let (cos, sin) = (a.re / scale, a.im / scale);
        let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let ray_from_car = turn * self.rotations[direction];
        let origin = Vector2::new(t.re, t.im);
        (scale > 1e-9 && cost.is_finite()).then_some(Appearance { cost, ray_from_car, scale, origin })
    }
}

/// Weighted sums from which least squares gives the best (a, t), over model points m and pixels z.
#[derive(Default)]
struct Sums {
    weight: f64,
    model: Complex<f64>,
    pixel: Complex<f64>,
    square: f64,
    cross: Complex<f64>,
}

impl Sums {
    fn add(&mut self, weight: f64, m: Complex<f64>, z: Complex<f64>) {
        self.weight += weight;
        self.model += m * weight;
        self.pixel += z * weight;
        self.square += weight * m.norm_sqr();
        self.cross += m.conj() * z * weight;
    }

    /// Returns the best scale with rotation (a) and shift (t), or `None` if all model points coincide.
    fn solve(&self) -> Option<(Complex<f64>, Complex<f64>)> {
        let (mean_m, mean_z) = (self.model / self.weight, self.pixel / self.weight);
        let spread = self.square - self.weight * mean_m.norm_sqr();
        let a = (self.cross - mean_m.conj() * mean_z * self.weight) / spread;
        (spread > 1e-12 * self.weight && a.is_finite()).then(|| (a, mean_z - a * mean_m))
    }
}
