//! Closed-form poses of a car of given shape on the ground plane, for a given camera.
//!
//! Headings all around the circle are tried. For each heading, every keypoint by itself determines the car's position.
//! The keypoint's viewing ray is intersected with the horizontal plane at the keypoint's height. The keypoint's
//! horizontal offset from the car's origin is then subtracted. The median over all keypoints is robust to outliers.

use nalgebra::{Vector2, Vector3};
use roadplane_base::{KEYPOINTS, median};

use crate::model::observation::Observation;
use crate::model::on_plane::PlanePose;
use crate::model::pose::{CameraFrame, Pose as _};

/// Number of headings tried around the circle.
const HEADINGS: usize = 32;

/// Sd of a keypoint due to the car's unknown shape, m. Its variance is added to that of the measurement.
const SHAPE_SD_M: f64 = 0.15;

/// Upper limit of the cost of one keypoint, which makes the cost robust to outliers.
const CAP: f64 = 9.0;

/// Returns up to `most` candidate poses with their costs, lowest cost first.
///
/// The candidates are the local minima of the cost as a function of the heading.
pub(crate) fn plane_pose_candidates(
    camera: &CameraFrame,
    points_in_car: &[Vector3<f64>; KEYPOINTS],
    observations: &[Observation],
    most: usize,
) -> Vec<(f64, PlanePose)> {
    let votes: Vec<(&Observation, Vector2<f64>)> = observations
        .iter()
        .filter_map(|o| Some((o, meeting(camera, o, points_in_car[o.index].z)?)))
        .collect();
    if votes.len() < 3 {
        return Vec::new();
    }
    let mut xs = vec![0.0; votes.len()];
    let mut ys = vec![0.0; votes.len()];
    let ring: Vec<Option<(f64, PlanePose)>> = (0..HEADINGS)
        .map(|h| {
            let heading = std::f64::consts::TAU * h as f64 / HEADINGS as f64;
            let (sin, cos) = heading.sin_cos();
            for (n, (o, at)) in votes.iter().enumerate() {
                let p = &points_in_car[o.index];
                xs[n] = at.x - (cos * p.x - sin * p.y);
                ys[n] = at.y - (sin * p.x + cos * p.y);
            }
            let pose = roadplane_base::GroundPose {
                x_m: median(&mut xs)?,
                y_m: median(&mut ys)?,
                heading_rad: heading,
            };
            let plane_pose = PlanePose::of(&pose, camera)?;
            Some((rough_cost(camera, points_in_car, observations, &plane_pose)?, plane_pose))
        })
        .collect();
    let mut minima: Vec<(f64, PlanePose)> = (0..HEADINGS)
        .filter_map(|h| {
            let here = ring[h]?;
            let cost = |k: usize| ring[k % HEADINGS].map_or(f64::INFINITY, |r| r.0);
            (here.0 <= cost(h + HEADINGS - 1) && here.0 < cost(h + 1)).then_some(here)
        })
        .collect();
    minima.sort_by(|a, b| a.0.total_cmp(&b.0));
    minima.truncate(most);
    minima
}

/// Returns the point (world x and y, m) where a keypoint's viewing ray meets the horizontal plane at height `z_m`.
fn meeting(camera: &CameraFrame, observation: &Observation, z_m: f64) -> Option<Vector2<f64>> {
    let f = camera.focal_px;
    let ray =
        camera.camera_from_world.tr_mul(&Vector3::new(observation.pixel.x / f, observation.pixel.y / f, 1.0));
    let length = (camera.height_m - z_m) / -ray.z;
    (ray.z < -1e-4 && length > 0.0).then(|| ray.xy() * length)
}

/// Returns the cost of a pose; `None` if the pose cannot be evaluated.
///
/// The cost per keypoint has an upper limit. Its variance includes the car's unknown shape.
pub(crate) fn rough_cost(
    camera: &CameraFrame,
    points_in_car: &[Vector3<f64>; KEYPOINTS],
    observations: &[Observation],
    plane_pose: &PlanePose,
) -> Option<f64> {
    let frame = plane_pose.frame(camera)?;
    let shape_sd_px = SHAPE_SD_M * camera.focal_px / frame.origin.z;
    let mut cost = 0.0;
    for o in observations {
        let off = frame.project(&points_in_car[o.index])? - o.pixel;
        let variance = shape_sd_px * shape_sd_px + 0.5 * o.covariance.trace();
        cost += 0.5 * o.weight * (off.norm_squared() / variance).min(CAP);
    }
    Some(cost)
}
