//! Pixels that the user gave in a frame of a moving camera.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{FrameRecord, PictureMotion};
use roadplane_geo::Site;

use crate::{CameraConstraints, PipelineError};

/// Converts the pixels of user constraints and of surveyed points to pixels of the camera's first picture.
///
/// `read` returns the frames as `calibrate::OneCamera` converts them. It is called only if a pixel belongs to a frame.
/// The last result has a warning for lengths and points that were left out.
///
/// # Errors
/// Errors of `read`.
pub(crate) fn in_first_picture<I>(
    constraints: &CameraConstraints,
    site: Option<&Site>,
    read: impl FnOnce() -> Result<I, PipelineError>,
) -> Result<(CameraConstraints, Option<Site>, Option<String>), PipelineError>
where
    I: Iterator<Item = Result<FrameRecord, PipelineError>>,
{
    let mut named: BTreeSet<u64> = constraints.frames().collect();
    named.extend(site.into_iter().flat_map(Site::frames));
    if named.is_empty() {
        return Ok((constraints.clone(), site.cloned(), None));
    }
    let views = views_of(&named, read()?)?;
    let (constraints, lengths) = constraints.with_frames(&views);
    let (site, points) = site.map(|site| site.in_first_picture(&views)).unzip();
    let left_out = lengths + points.unwrap_or(0);
    let missing: Vec<String> =
        named.iter().filter(|frame| !views.contains_key(frame)).map(u64::to_string).collect();
    let warning = (left_out > 0).then(|| {
        format!(
            "{left_out} given lengths or map points were left out: the camera is not known to be at its first position in frame {}",
            missing.join(", ")
        )
    });
    Ok((constraints, site, warning))
}

/// Returns the mapping from pixels of each of the frames `named` to pixels of the camera's first picture. Frames of
/// other places, and frames whose position is not known, are missing.
fn views_of(
    named: &BTreeSet<u64>,
    frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
) -> Result<BTreeMap<u64, PictureMotion>, PipelineError> {
    let mut views = BTreeMap::new();
    for frame in frames {
        let frame = frame?;
        if !named.contains(&frame.frame) {
            continue;
        }
        let watch = frame.watch.as_ref();
        if watch.is_some_and(|watch| watch.left_out.is_some() || watch.place.is_some_and(|place| place > 0)) {
            continue;
        }
        let picture_from_world = watch.and_then(|watch| watch.picture_from_world);
        views.insert(frame.frame, picture_from_world.map_or(PictureMotion::IDENTITY, |view| view.inverse()));
    }
    Ok(views)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use roadplane_base::Homography;
    use roadplane_base::{ImageSize, NotFollowedReason, WatchRecord};

    #[test]
    fn frames_of_the_first_place_have_views() {
        let size = ImageSize { width: 640, height: 360 };
        let shift = Homography::from_numbers([1.0, 0.0, 5.0, 0.0, 1.0, -3.0, 0.0, 0.0]).unwrap();
        let frame = |number: u64| {
            let watch = WatchRecord {
                place: Some(usize::from(number == 3)),
                left_out: (number == 2).then_some(NotFollowedReason::NotRegistered),
                picture_from_world: (number == 1).then_some(shift.into()),
                ..WatchRecord::default()
            };
            Ok(FrameRecord { watch: Some(watch), ..FrameRecord::empty(number, number as f64 * 0.1, size) })
        };
        let views = views_of(&[0, 1, 2, 3, 9].into(), (0..5).map(frame)).unwrap();
        assert_eq!(views.keys().copied().collect::<Vec<_>>(), [0, 1]);
        assert_eq!(views[&0], PictureMotion::IDENTITY);
        assert_eq!(views[&1].apply(&Vector2::new(10.0, 10.0)), Vector2::new(5.0, 13.0));
    }
}
