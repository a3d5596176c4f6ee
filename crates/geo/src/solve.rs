//! Camera and place solved together: a survey is evidence on focal length, tilt and height as well.
//!
//! Unknown are `p = (log focal, tilt, roll, log height, turn, east, north)`; the camera's part has the run's estimate as its
//! prior. A point's ground lies at `R(turn) · g(pixel; camera) + (east, north)`, where g is where its viewing ray meets the
//! plane. Errors are those of the pixel, carried to the ground, and of the survey. Solved by Gauss–Newton.

use nalgebra::{Matrix2, Matrix4, Rotation2, SMatrix, SVector, Vector2, Vector4};
use roadplane_base::{Camera, CameraEstimate, CameraParams, GroundPlane, Similarity};

use crate::SurveyPoint;

/// How well people click on a point, px.
const PIXEL_SD: f64 = 1.5;
/// How well points are surveyed, m.
const SURVEY_SD_M: f64 = 0.15;
/// Widest prior of each of the camera's numbers, where the run knows nothing.
const WIDE_SD: f64 = 1.0;
/// Narrowest.
const GIVEN_SD: f64 = 1e-5;
const STEPS: usize = 50;
const HALVINGS: usize = 20;
const NO_FIT: &str =
    "no place fits the points and the camera: check the pixels, and the order of latitude and longitude";

/// log focal (px), tilt, roll (rad), log height (m), turn (rad), east, north (m).
pub(crate) type Params = SVector<f64, 7>;
/// Their covariance.
pub(crate) type Covariance = SMatrix<f64, 7, 7>;

/// Camera and place, with their covariance.
#[derive(Clone, Debug)]
pub(crate) struct Solved {
    pub params: Params,
    pub covariance: Covariance,
    pub view: Camera,
}

/// What a point is worth where it is seen.
pub(crate) struct SeenPoint {
    /// Derivatives of its place by the parameters.
    pub by_params: SMatrix<f64, 2, 7>,
    /// Covariance of its place by the click, m².
    pub click: Matrix2<f64>,
}

impl SeenPoint {
    /// Inverse covariance of click and survey.
    pub fn weight(&self) -> Option<Matrix2<f64>> {
        (self.click + Matrix2::identity() * SURVEY_SD_M.powi(2)).try_inverse()
    }
}

impl Solved {
    /// From the camera as it is known and points that lie at `targets`, east and north, m.
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

    /// The camera's part, and the foot of the camera at a place that is known exactly.
    pub fn from_camera(camera: &CameraEstimate, turn: f64, [east, north]: [f64; 2]) -> Result<Self, String> {
        let mut solved = Self::of_camera(camera);
        solved.params.fixed_rows_mut::<3>(4).copy_from_slice(&[turn, east, north]);
        let known = prior_information(camera).try_inverse().ok_or("the camera is not known")?;
        solved.covariance.fixed_view_mut::<4, 4>(0, 0).copy_from(&known);
        Ok(solved)
    }

    /// In the run's own world.
    pub fn of_camera(camera: &CameraEstimate) -> Self {
        let mut params = Params::zeros();
        params.fixed_rows_mut::<4>(0).copy_from(&camera.params.to_vector());
        Self { params, covariance: Covariance::zeros(), view: camera.camera() }
    }

    /// The camera.
    pub fn camera(&self) -> CameraParams {
        CameraParams::from_vector(&self.params.fixed_rows::<4>(0).into_owned())
    }

    /// Where the camera's foot is, east and north, m.
    pub fn foot(&self) -> Vector2<f64> {
        self.params.fixed_rows::<2>(5).into_owned()
    }

    /// Where a point lies on the map, east and north; `None` at or above the horizon.
    pub fn place_of(&self, point: &SurveyPoint) -> Option<Vector2<f64>> {
        Some(self.seen_from_foot(&self.params, point)? + self.foot())
    }

    /// What a point is worth where it is seen; `None` at or above the horizon.
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

    /// χ² of what the camera had to give way, four degrees of freedom.
    pub fn given_way(&self, camera: &CameraEstimate) -> f64 {
        let away = self.camera().to_vector() - camera.params.to_vector();
        away.dot(&(prior_information(camera) * away))
    }

    /// From the camera's foot: no large numbers, so that differences are exact.
    fn seen_from_foot(&self, params: &Params, point: &SurveyPoint) -> Option<Vector2<f64>> {
        let camera = CameraParams::from_vector(&params.fixed_rows::<4>(0).into_owned());
        let ground = camera.plane();
        // A point above the ground lies on a plane that the camera is less high above.
        let plane = GroundPlane { height_m: ground.height_m - point.height_m, ..ground };
        let camera = Camera { focal_px: camera.focal_px(), ..self.view };
        let at = plane.world_from_pixel(&camera, &Vector2::from(point.pixel));
        at.filter(|_| plane.height_m > 0.0).map(|at| Rotation2::new(params[4]) * at)
    }

    /// A step of Gauss–Newton subtracted, shortened until all points lie on the ground.
    fn stepped(&self, step: &Params, points: &[SurveyPoint]) -> Option<Params> {
        let candidates = (0..HALVINGS).map(|i| self.params - step / f64::from(1u32 << i));
        let all_seen = |params: Params| {
            let there = Self { params, ..self.clone() };
            points.iter().all(|point| there.seen_point(point).is_some())
        };
        candidates.into_iter().find(|params| all_seen(*params))
    }
}

/// The camera as it is, and the turn and shift that fit it best.
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

fn prior_information(camera: &CameraEstimate) -> Matrix4<f64> {
    let known = camera.covariance.iter().all(|v| v.is_finite());
    let covariance = if known { camera.covariance } else { Matrix4::identity() * WIDE_SD.powi(2) };
    // What was given has no variance.
    let given = Matrix4::identity() * GIVEN_SD.powi(2);
    (covariance + given).try_inverse().unwrap_or(Matrix4::identity() / WIDE_SD.powi(2))
}
