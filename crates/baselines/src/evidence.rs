//! Converts a car's keypoints to the input of both baselines: viewing rays with confidences.

use nalgebra::{Vector2, Vector3};
use roadplane_base::{Camera, KeypointSet, MIN_KEYPOINTS};

/// One observed keypoint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    /// Index of the keypoint.
    pub index: usize,
    /// Viewing ray in the camera frame, with z = 1.
    pub ray: Vector3<f64>,
    /// Confidence of the keypoint, 0–1.
    pub weight: f64,
}

impl Observation {
    /// Returns the image coordinates of the keypoint for a camera with focal length 1.
    pub fn xy(&self) -> Vector2<f64> {
        self.ray.xy()
    }
}

/// Returns the usable keypoints of a car: those with finite coordinates and a confidence above zero. Returns `None` if
/// fewer than [`MIN_KEYPOINTS`] are usable, or if the focal length is not valid.
pub(crate) fn observations(camera: &Camera, keypoints: &KeypointSet) -> Option<Vec<Observation>> {
    if !(camera.focal_px.is_finite() && camera.focal_px > 0.0) {
        return None;
    }
    let usable = keypoints.iter().enumerate().filter_map(|(index, keypoint)| {
        let keypoint = (*keypoint)?;
        let weight = keypoint.score.min(1.0);
        let ray = camera.ray_from_pixel(&keypoint.pixel);
        let finite = ray.iter().all(|v| v.is_finite() && v.abs() < 1e6);
        (finite && weight > 0.0).then_some(Observation { index, ray, weight })
    });
    let observations: Vec<Observation> = usable.collect();
    (observations.len() >= MIN_KEYPOINTS).then_some(observations)
}
