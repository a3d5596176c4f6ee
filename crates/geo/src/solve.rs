//! Estimates a camera and its position on the map together. Surveyed points also give information on the camera's
//! parameters.
//!
//! The unknowns are `p = (log focal, tilt, roll, log height, turn, east, north)`. The run's estimate is the prior of
//! the first four unknowns. `(east, north)` is the map position of the point below the camera. `turn` is the angle of
//! the rotation R from the camera's world frame to the map.
//!
//! Let g be the point of the world frame at which the viewing ray of a pixel meets the ground plane. Its map position
//! is `R(turn) · g + (east, north)`. Two errors contribute to the residual: the pixel's error, propagated to the
//! ground, and the survey's error. The solver is Gauss–Newton.

use nalgebra::{Matrix2, Matrix4, Rotation2, SMatrix, SVector, Vector2, Vector4};
use roadplane_base::{Camera, CameraEstimate, CameraParams, GroundPlane, Similarity};

use crate::SurveyPoint;

/// Sd of the pixel that the user marks for a point, px.
const PIXEL_SD: f64 = 1.5;
/// Sd of a surveyed position, m.
const SURVEY_SD_M: f64 = 0.15;
/// Prior sd of each camera parameter if the run could not estimate the camera.
const WIDE_SD: f64 = 1.0;
/// Smallest prior sd of each camera parameter. Its square is added to the variance, which may be 0 for a parameter that
/// the user gave.
const GIVEN_SD: f64 = 1e-5;
/// Largest number of Gauss–Newton steps.
const STEPS: usize = 50;
/// Largest number of halvings of a step.
const HALVINGS: usize = 20;
const NO_FIT: &str =
    "no position fits the points and the camera: check the pixels, and the order of latitude and longitude";

/// The unknowns: log focal (px), tilt, roll (rad), log height (m), turn (rad), east, north (m).
pub(crate) type Params = SVector<f64, 7>;
/// Covariance of the unknowns.
pub(crate) type Covariance = SMatrix<f64, 7, 7>;

/// A camera and its position on the map, with their covariance.
#[derive(Clone, Debug)]
pub(crate) struct Solved {
    /// Values of the unknowns.
    pub params: Params,
    /// Covariance of the unknowns.
    pub covariance: Covariance,
    /// Principal point and lens of the camera.
    pub view: Camera,
}

/// Uncertainty of the map position of a point in the picture.
pub(crate) struct SeenPoint {
    /// Derivatives of the map position with respect to the unknowns.
    pub by_params: SMatrix<f64, 2, 7>,
    /// Covariance of the map position due to the error of the pixel, m².
    pub click: Matrix2<f64>,
}

impl SeenPoint {
    /// Returns the inverse covariance of a point's residual, 1/m². It combines the errors of the pixel and of the
    /// survey.
    pub fn weight(&self) -> Option<Matrix2<f64>> {
        (self.click + Matrix2::identity() * SURVEY_SD_M.powi(2)).try_inverse()
    }
}

impl Solved {
    /// Estimates a camera and its map position from the run's camera and surveyed points.
    ///
    /// `targets` contains the map positions of the points (easting and northing, m).
    pub fn from_points(
        camera: &CameraEstimate,
        points: &[SurveyPoint],
        targets: &[Vector2<f64>],
    ) -> Result<Self, String> {
        let prior = camera.params.to_vector();
        let information = prior_information(camera);
        let mut solved = start(camera, points, targets)?;
        let mut normal = Covariance::identity();
        for _ in 0..STEPS {
            let mut gradient = Params::zeros();
            normal = Covariance::zeros();
            normal.fixed_view_mut::<4, 4>(0, 0).copy_from(&information);
            let away: Vector4<f64> = solved.params.fixed_rows::<4>(0) - prior;
            gradient.fixed_rows_mut::<4>(0).copy_from(&(information * away));
            for (point, target) in points.iter().zip(targets) {
                let error = solved.place_of(point).ok_or(NO_FIT)? - target;
                let seen = solved.seen_point(point).ok_or(NO_FIT)?;
                let weight = seen.weight().ok_or(NO_FIT)?;
                gradient += seen.by_params.transpose() * weight * error;
                normal += seen.by_params.transpose() * weight * seen.by_params;
            }
            let step = normal.cholesky().ok_or(NO_FIT)?.solve(&gradient);
            solved.params = solved.stepped(&step, points).ok_or(NO_FIT)?;
            if step.fixed_rows::<5>(0).amax() < 1e-10 && step.fixed_rows::<2>(5).amax() < 1e-6 {
                break;
            }
        }
        solved.covariance = normal.try_inverse().ok_or(NO_FIT)?;
        Ok(solved)
    }

    /// Returns the run's camera at an exact position and turn on the map.
    ///
    /// The position is that of the point below the camera (easting and northing, m). The turn is in rad.
    pub fn from_camera(camera: &CameraEstimate, turn: f64, [east, north]: [f64; 2]) -> Result<Self, String> {
        let mut solved = Self::of_camera(camera);
        solved.params.fixed_rows_mut::<3>(4).copy_from_slice(&[turn, east, north]);
        let camera_covariance =
            prior_information(camera).try_inverse().ok_or("the camera has a singular covariance")?;
        solved.covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&camera_covariance);
        Ok(solved)
    }

    /// Returns the run's camera in the run's own world frame, with a covariance of zero.
    pub fn of_camera(camera: &CameraEstimate) -> Self {
        let mut params = Params::zeros();
        params.fixed_rows_mut::<4>(0).copy_from(&camera.params.to_vector());
        Self { params, covariance: Covariance::zeros(), view: camera.camera() }
    }

    /// Returns the camera parameters.
    pub fn camera(&self) -> CameraParams {
        CameraParams::from_vector(&self.params.fixed_rows::<4>(0).into_owned())
    }

    /// Returns the map position of the point below the camera (easting and northing, m).
    pub fn foot(&self) -> Vector2<f64> {
        self.params.fixed_rows::<2>(5).into_owned()
    }

    /// Returns the map position of a point in the picture (easting and northing, m).
    ///
    /// Returns `None` if the point lies at or above the horizon.
    pub fn place_of(&self, point: &SurveyPoint) -> Option<Vector2<f64>> {
        Some(self.seen_from_foot(&self.params, point)? + self.foot())
    }

    /// Returns the uncertainty of the map position of a point in the picture.
    ///
    /// Returns `None` if the point lies at or above the horizon.
    pub fn seen_point(&self, point: &SurveyPoint) -> Option<SeenPoint> {
        let mut by_params = SMatrix::<f64, 2, 7>::zeros();
        for i in 0..5 {
            let moved = |step: f64| {
                let mut params = self.params;
                params[i] += step;
                self.seen_from_foot(&params, point)
            };
            by_params.set_column(i, &((moved(1e-6)? - moved(-1e-6)?) / 2e-6));
        }
        by_params[(0, 5)] = 1.0;
        by_params[(1, 6)] = 1.0;
        let mut by_pixel = Matrix2::zeros();
        for i in 0..2 {
            let moved = |step: f64| {
                let mut point = *point;
                point.pixel[i] += step;
                self.seen_from_foot(&self.params, &point)
            };
            by_pixel.set_column(i, &((moved(1e-3)? - moved(-1e-3)?) / 2e-3));
        }
        Some(SeenPoint { by_params, click: by_pixel * by_pixel.transpose() * PIXEL_SD.powi(2) })
    }

    /// Returns the χ² of the difference between this camera and the run's camera. It has four degrees of freedom.
    pub fn camera_chi2(&self, camera: &CameraEstimate) -> f64 {
        let away = self.camera().to_vector() - camera.params.to_vector();
        away.dot(&(prior_information(camera) * away))
    }

    /// Returns the map position of a point relative to the point below the camera, m.
    ///
    /// These numbers are small, so their differences are computed exactly.
    fn seen_from_foot(&self, params: &Params, point: &SurveyPoint) -> Option<Vector2<f64>> {
        let camera = CameraParams::from_vector(&params.fixed_rows::<4>(0).into_owned());
        let ground = camera.plane();
        // A point above the ground lies on a parallel plane that is closer to the camera.
        let plane = GroundPlane { height_m: ground.height_m - point.height_m, ..ground };
        let camera = Camera { focal_px: camera.focal_px(), ..self.view };
        let at = plane.world_from_pixel(&camera, &Vector2::from(point.pixel));
        at.filter(|_| plane.height_m > 0.0).map(|at| Rotation2::new(params[4]) * at)
    }

    /// Returns the parameters after a Gauss–Newton step. The step is halved until all points lie below the horizon.
    fn stepped(&self, step: &Params, points: &[SurveyPoint]) -> Option<Params> {
        let candidates = (0..HALVINGS).map(|i| self.params - step / f64::from(1u32 << i));
        let all_seen = |params: Params| {
            let there = Self { params, ..self.clone() };
            points.iter().all(|point| there.seen_point(point).is_some())
        };
        candidates.into_iter().find(|params| all_seen(*params))
    }
}

/// Returns the start of the iteration: the run's camera, with the turn and shift that fit the points best.
fn start(
    camera: &CameraEstimate,
    points: &[SurveyPoint],
    targets: &[Vector2<f64>],
) -> Result<Solved, String> {
    let mut solved = Solved::of_camera(camera);
    let first = *targets.first().ok_or("no points")?;
    let mut pairs = Vec::new();
    for (i, (point, target)) in points.iter().zip(targets).enumerate() {
        let ground = solved
            .place_of(point)
            .ok_or_else(|| format!("point {} lies at or above the horizon of the run's camera", i + 1))?;
        pairs.push((ground, target - first));
    }
    let similarity = Similarity::fit(&pairs).ok_or("no points")?;
    let foot = similarity.apply(&Vector2::zeros()) + first;
    solved.params.fixed_rows_mut::<3>(4).copy_from_slice(&[similarity.turn(), foot.x, foot.y]);
    Ok(solved)
}

/// Returns the inverse covariance of the prior on the camera parameters.
fn prior_information(camera: &CameraEstimate) -> Matrix4<f64> {
    let is_estimated = camera.covariance.iter().all(|v| v.is_finite());
    let covariance = if is_estimated { camera.covariance } else { Matrix4::identity() * WIDE_SD.powi(2) };
    // The variance of a parameter that the user gave may be 0.
    let given = Matrix4::identity() * GIVEN_SD.powi(2);
    (covariance + given).try_inverse().unwrap_or(Matrix4::identity() / WIDE_SD.powi(2))
}
