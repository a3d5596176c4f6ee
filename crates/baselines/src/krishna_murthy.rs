//! The method of Krishna Murthy et al. 2017. It adjusts the pose of a car, then pose and shape together (§III-C and
//! III-D of their paper).
//!
//! Both steps minimise the reprojection error of the keypoints with iteratively reweighted least squares. The first
//! step uses the mean car. A keypoint's weight is its confidence times a robust weight of its residual. The shape prior
//! is quadratic in the coefficients.
//!
//! Their paper has two more terms, symmetry and planarity. All shapes of the shape atlas satisfy both, so this code
//! needs neither.
//!
//! In their paper, the camera is on a car. Two inputs of their method do not exist for a surveillance camera:
//! - In their paper, a net gives the viewpoint. This code starts from eight azimuths, and returns the result with the
//!   lowest cost.
//! - In their paper, the camera's axis is parallel to the ground, and its height is known. So the lower edge of a box
//!   gives the position of the car. A surveillance camera has an unknown tilt. This code starts at the depth at which
//!   the mean car is as large as the box, and tries two tilts for each azimuth. The rotation has three degrees of
//!   freedom, because a camera that is assumed to be level would allow no right pose. After its start, their method has
//!   the same freedom.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{Camera, KeypointSet, Shape, ShapeAtlas};
use roadplane_solve::{LmOptions, minimise};

use crate::CarFit;
use crate::evidence::{Observation, observations};
use crate::reprojection::{Reprojection, State};

/// Number of initial azimuths of the car.
const AZIMUTHS: usize = 8;
/// Initial tilts of the camera, rad: a level camera as in the paper, and a camera that is tilted down.
const TILTS: [f64; 2] = [0.0, 0.5];
/// Sd of a keypoint, as a share of the longer side of the car's box.
const SD_SHARE: f64 = 0.03;
/// Residual above which a keypoint's weight falls (Huber loss), in sds.
const HUBER_SD: f64 = 1.5;
/// Largest number of rounds of reweighting per step.
const REWEIGHTINGS: usize = 8;
/// Relative decrease of the robust cost below which the reweighting ends.
const COST_TOLERANCE: f64 = 1e-6;

/// Fits the pose and shape of one car in front of a calibrated camera.
///
/// Returns `None` with fewer than five usable keypoints, or if no initial pose has a finite cost.
#[must_use]
pub fn krishna_murthy(atlas: &ShapeAtlas, camera: &Camera, keypoints: &KeypointSet) -> Option<CarFit> {
    let observations = observations(camera, keypoints)?;
    let (low, high) =
        observations.iter().fold((observations[0].xy(), observations[0].xy()), |(low, high), s| {
            (low.inf(&s.xy()), high.sup(&s.xy()))
        });
    let sigma = SD_SHARE * (high - low).max();
    if !(sigma.is_finite() && sigma > 0.0) {
        return None;
    }
    let mut best: Option<(f64, State)> = None;
    for tilt in TILTS {
        for a in 0..AZIMUTHS {
            let azimuth = std::f64::consts::TAU * a as f64 / AZIMUTHS as f64;
            let start = start(atlas, &observations, [low, high], azimuth, tilt);
            let mut problem = Reprojection::new(atlas, &observations, sigma, start);
            if let Some(cost) = adjust(&mut problem, &observations)
                && best.is_none_or(|(lowest, _)| cost < lowest)
            {
                best = Some((cost, problem.state));
            }
        }
    }
    let mut problem = Reprojection::new(atlas, &observations, sigma, best?.1);
    problem.shape_free = true;
    adjust(&mut problem, &observations)?;
    let State { camera_from_car, translation, shape } = problem.state;
    let camera_from_car = Isometry3::from_parts(Translation3::from(translation), camera_from_car);
    Some(CarFit { camera_from_car, shape })
}

/// Returns the initial state: the mean car at an azimuth, for a camera with the given tilt. The car is in the middle of
/// the box, and is as large as the box.
fn start(
    atlas: &ShapeAtlas,
    observations: &[Observation],
    [low, high]: [Vector2<f64>; 2],
    azimuth: f64,
    tilt: f64,
) -> State {
    // The columns are the car's axes in the frame of a level camera. At azimuth 0, the car's front points to the right
    // and its left side points away from the camera.
    let level = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(level));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth);
    let look_down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), tilt);
    let camera_from_car = look_down * level * turn;
    let points: Vec<Vector3<f64>> = observations
        .iter()
        .map(|s| camera_from_car * atlas.keypoint_in_car(s.index, &Shape::zeros()))
        .collect();
    let (first, last) =
        points.iter().fold((points[0], points[0]), |(a, b), point| (a.inf(point), b.sup(point)));
    let depth = (last - first).xy().norm() / (high - low).norm();
    let middle = ((low + high) / 2.0).push(1.0) * depth;
    let translation = middle - (first + last) / 2.0;
    State { camera_from_car, translation, shape: Shape::zeros() }
}

/// Runs iteratively reweighted least squares until convergence. Returns the robust cost, or `None` if the cost cannot
/// be computed.
fn adjust(problem: &mut Reprojection<'_>, observations: &[Observation]) -> Option<f64> {
    let options = LmOptions { max_iterations: 30, cost_tolerance: 1e-7, ..LmOptions::default() };
    let mut last_cost = f64::INFINITY;
    for _ in 0..REWEIGHTINGS {
        minimise(problem, &options);
        let mut cost = 0.5 * problem.state.shape.norm_squared();
        for ((residual, s), weight) in
            problem.residuals(&problem.state)?.iter().zip(observations).zip(&mut problem.weights)
        {
            let off = residual.norm();
            let (robust, share) = huber(off);
            cost += s.weight * robust;
            *weight = s.weight * share;
        }
        if !cost.is_finite() {
            return None;
        }
        if last_cost - cost <= COST_TOLERANCE * cost {
            return Some(cost);
        }
        last_cost = cost;
    }
    Some(last_cost)
}

/// Returns the Huber loss and the Huber weight of a residual. `off` is the length of the residual in sds.
fn huber(off: f64) -> (f64, f64) {
    if off <= HUBER_SD { (0.5 * off * off, 1.0) } else { (HUBER_SD * (off - 0.5 * HUBER_SD), HUBER_SD / off) }
}
