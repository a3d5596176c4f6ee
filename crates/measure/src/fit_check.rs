//! Validates keypoints and fitted cars.
//!
//! Nets find keypoints in any object, and the solver fits a car to them.

use nalgebra::{Isometry3, Point3};
use roadplane_base::{
    Camera, KEYPOINTS, KeypointSet, Shape, ShapeAtlas, bbox_inside, bbox_iou, bbox_longer_side,
};

/// Returns the keypoints whose score is at least `min_score`.
#[must_use]
pub fn usable(keypoints: &KeypointSet, min_score: f64) -> KeypointSet {
    keypoints.map(|point| point.filter(|point| point.score >= min_score))
}

/// Limits of a valid fit.
#[derive(Clone, Copy, Debug)]
pub struct FitLimits {
    /// Least intersection over union of a car's projected box and its detected box, 0–1.
    pub min_box_overlap: f64,
    /// Largest rms distance of the keypoints from their projections, as a share of the box's longer side.
    pub max_rms_share: f64,
}

/// Returns the box around the projected keypoints of a car, px; `None` if a part of it is not in front of the camera.
#[must_use]
pub fn projected_box(
    atlas: &ShapeAtlas,
    camera: &Camera,
    camera_from_car: &Isometry3<f64>,
    shape: &Shape,
) -> Option<[f64; 4]> {
    let mut bbox = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for index in 0..KEYPOINTS {
        let point = Point3::from(atlas.keypoint_in_car(index, shape));
        let pixel = camera.pixel_from_camera(&(camera_from_car * point).coords)?;
        bbox = [bbox[0].min(pixel.x), bbox[1].min(pixel.y), bbox[2].max(pixel.x), bbox[3].max(pixel.y)];
    }
    Some(bbox)
}

impl FitLimits {
    /// Returns whether a fit is valid.
    ///
    /// A fit is valid if its keypoints are near their projections, and its projected box agrees with the detected one.
    /// Only the part of the box inside the picture, `picture_px`, counts.
    #[must_use]
    pub fn is_valid(
        &self,
        projected_px: Option<[f64; 4]>,
        bbox_px: &[f64; 4],
        reprojection_rms_px: f64,
        picture_px: &[f64; 4],
    ) -> bool {
        let Some(projected_px) = projected_px else { return false };
        let side_px = bbox_longer_side(bbox_px);
        bbox_iou(&bbox_inside(&projected_px, picture_px), bbox_px) >= self.min_box_overlap
            && reprojection_rms_px <= self.max_rms_share * side_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::ImageSize;

    /// Size of the test pictures, px.
    const SIZE: ImageSize = ImageSize { width: 640, height: 480 };

    #[test]
    fn a_fit_must_fill_its_box_as_far_as_it_is_in_the_picture() {
        let limits = FitLimits { min_box_overlap: 0.5, max_rms_share: 0.07 };
        let valid =
            |projected, bbox: [f64; 4], rms| limits.is_valid(projected, &bbox, rms, &SIZE.picture_px());
        let whole = [100.0, 100.0, 200.0, 160.0];
        assert!(valid(Some(whole), whole, 2.0));
        assert!(!valid(Some(whole), whole, 20.0));
        assert!(!valid(Some([100.0, 100.0, 140.0, 130.0]), whole, 2.0));
        assert!(!valid(None, whole, 2.0));
        // The left edge of the picture cuts off half of the car.
        assert!(valid(Some([-100.0, 100.0, 100.0, 200.0]), [0.0, 100.0, 100.0, 200.0], 2.0));
    }
}
