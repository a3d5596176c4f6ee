//! Converts the evidence of a clip to the picture that the camera database keeps of the scene, and back.
//!
//! A clip's camera is that of its world picture, the first reference of a place. The camera database compares pictures
//! of the empty scene. Such a picture shows the last part of the clip, at the mean position of a camera that sways. So
//! the evidence is that of the camera which takes this picture.

use nalgebra::Vector2;
use roadplane_base::{ImageSize, ParkedCar, PictureMotion, Registration};
use roadplane_calibrate::{Places, WindowEstimate, turned_information};

/// Returns the mapping from the world picture of a position to a picture of the empty scene with this registration.
/// `None` if the picture does not show the position with this index.
pub(crate) fn scene_from_world(
    registration: Option<&Registration>,
    places: &Places,
    position: usize,
    size: ImageSize,
) -> Option<PictureMotion> {
    let Some(registration) = registration.filter(|_| places.is_measured) else {
        return Some(PictureMotion::IDENTITY);
    };
    let (place, scene_from_world) = places.position(registration, size)?;
    (place == position).then_some(scene_from_world)
}

/// Returns the evidence of a window on the camera that has turned by a motion; `None` if the motion is no turn.
pub(crate) fn turned(window: WindowEstimate, motion: &PictureMotion) -> Option<WindowEstimate> {
    if motion.is_identity() {
        return Some(window);
    }
    let (params, joint) =
        turned_information(&window.params, &window.joint, &motion.homography, &motion.centre_px)?;
    Some(WindowEstimate { params, joint, ..window })
}

/// Converts a parked car to the picture after a motion.
pub(crate) fn moved(car: ParkedCar, motion: &PictureMotion) -> ParkedCar {
    if motion.is_identity() {
        return car;
    }
    let moved = |pixel: [f64; 2]| motion.apply(&Vector2::from(pixel)).into();
    ParkedCar {
        bbox_px: motion.apply_to_box(&car.bbox_px),
        keypoints_px: car.keypoints_px.iter().map(|pixel| pixel.map(moved)).collect(),
    }
}
