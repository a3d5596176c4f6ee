//! The second plane of a site whose ground has a fold.

use roadplane_base::{CameraEstimate, GroundPlane, SecondPlane};
use roadplane_calibrate::{Fold, Joined};

/// Adds the second plane to the camera above the first one: of the two estimates in `joined`, the second one is removed.
///
/// Returns `None` if the camera has other estimates, or if the planes do not divide the picture like the fold.
pub(super) fn with_second_plane(fold: &Fold, mut joined: Joined) -> Option<Joined> {
    if joined.segments[..] != [0, 1] {
        return None;
    }
    joined.segments.pop();
    let CameraEstimate { params, covariance, .. } = joined.estimates.pop()?;
    let first = joined.estimates.first_mut()?;
    let ray = |index: usize| fold.middles_px[index].push(first.params.focal_px());
    let inverse_distance = |plane: &GroundPlane| -plane.normal_in_camera.dot(&ray(1)) / plane.height_m;
    let rises = inverse_distance(&params.plane()) > inverse_distance(&first.params.plane());
    first.second_plane = Some(SecondPlane { params, covariance, rises });
    let ground = first.ground();
    (0..2).all(|index| ground.part_of_ray(&ray(index)).index == index).then_some(joined)
}
