//! The second plane of a site whose ground has a fold.

use roadplane_base::{CameraEstimate, CameraStatus, SecondPlane};
use roadplane_calibrate::{Fold, Joined};

/// Adds the second plane to the camera above the first one: of the two estimates in `joined`, the second one is removed.
///
/// Returns `None` if the camera has other estimates or if the cars do not determine both planes. Also returns `None` if
/// the planes do not divide the picture like the fold.
pub(super) fn with_second_plane(fold: &Fold, mut joined: Joined) -> Option<Joined> {
    let is_determined = |estimate: &CameraEstimate| estimate.status != CameraStatus::Unobservable;
    if !joined.estimates.keys().eq(&[0, 1]) || !joined.estimates.values().all(is_determined) {
        return None;
    }
    let CameraEstimate { params, covariance, .. } = joined.estimates.remove(&1)?;
    let first = joined.estimates.get_mut(&0)?;
    let rays = fold.middles_px.map(|middle| middle.push(first.params.focal_px()));
    let rises = params.plane().inverse_distance(&rays[1]) > first.params.plane().inverse_distance(&rays[1]);
    first.second_plane = Some(SecondPlane { params, covariance, rises });
    let ground = first.ground();
    let is_divided = (0..2).all(|index| ground.part_of_ray(&rays[index]).index == index);
    is_divided.then_some(joined)
}
