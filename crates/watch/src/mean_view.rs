//! The mean position of the pictures on a keyframe.

use nalgebra::Vector2;
use roadplane_base::Homography;

use crate::View;
use crate::position::AVERAGED;
use crate::view::NOT_DISPLACED_PX;

/// Number of points in each direction that are averaged.
const POINTS: usize = 5;

/// The mean position of the last pictures on a keyframe. A camera that sways has about the same mean position in all
/// clips.
#[derive(Clone, Debug, Default)]
pub(crate) struct MeanView {
    /// Points of the keyframe and their mean positions in the pictures, px.
    points: Vec<(Vector2<f64>, Vector2<f64>)>,
    /// Number of pictures in the mean, at most [`AVERAGED`].
    averaged: f64,
}

impl MeanView {
    /// Adds the next picture.
    pub(crate) fn add(&mut self, view: &View) {
        if self.points.is_empty() {
            let [left, top, right, bottom] = view.picture_px();
            let at = |i: usize, from: f64, to: f64| from + (to - from) * i as f64 / (POINTS - 1) as f64;
            let point = |i: usize| Vector2::new(at(i % POINTS, left, right), at(i / POINTS, top, bottom));
            self.points = (0..POINTS * POINTS).map(|i| (point(i), point(i))).collect();
        }
        self.averaged = (self.averaged + 1.0).min(AVERAGED);
        for (point, mean) in &mut self.points {
            *mean += (view.picture_from_keyframe.apply(point) - *mean) / self.averaged;
        }
    }

    /// Returns the homography from the keyframe to the mean position, px. `None` if it is not displaced.
    pub(crate) fn homography(&self) -> Option<Homography> {
        let unit = self.points.last()?.0.norm().max(1.0);
        let pairs = self.points.iter().map(|(point, mean)| (point / unit, mean / unit, 1.0));
        let (found, _) = Homography::fit(pairs, None)?;
        let found = found.in_coordinates(unit, Vector2::zeros());
        let off = |(point, _): &(Vector2<f64>, _)| (found.apply(point) - point).norm() > NOT_DISPLACED_PX;
        self.points.iter().any(off).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{ImageSize, Lens, PictureMotion};

    #[test]
    fn a_sway_has_its_middle_as_mean_position() {
        let size = ImageSize { width: 640, height: 360 };
        let mut mean = MeanView::default();
        for i in 0..300 {
            let x = 7.0 + 12.0 * (0.2 * f64::from(i)).sin();
            let shift = Homography::from_numbers([1.0, 0.0, x, 0.0, 1.0, -2.0, 0.0, 0.0]).unwrap();
            mean.add(&View::new(Some(0), PictureMotion::new(shift, Lens::STRAIGHT, size), size));
        }
        let at = mean.homography().unwrap().apply(&Vector2::new(100.0, 200.0));
        assert!((at - Vector2::new(107.0, 198.0)).norm() < 1.0, "{at}");
        let mut rest = MeanView::default();
        rest.add(&View::new(Some(0), PictureMotion::IDENTITY, size));
        assert!(rest.homography().is_none());
    }
}
