//! How a picture shows a keyframe of the place.

use image::RgbImage;
use nalgebra::Vector2;
use roadplane_base::{ImageSize, PictureMotion, bbox_inside, bbox_share_inside};

use crate::SmallGrey;
use crate::level::resampled;

/// Displacement up to which a picture counts as not displaced, px of the frame. It is within the noise of boxes and
/// keypoints.
pub(crate) const NOT_DISPLACED_PX: f64 = 0.5;

/// How a picture shows a keyframe of the place: an earlier picture on which it is registered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Index of the keyframe's frame. `None` if the pictures have too little structure for a keyframe. Then the camera
    /// counts as at rest. Where a minute begins while the camera is at rest, the new keyframe keeps the index of the old
    /// one.
    pub keyframe: Option<u64>,
    /// Index of the frame on which the picture is registered.
    pub reference: Option<u64>,
    /// Mapping from pixels of the keyframe to pixels of the picture. It is the identity if the picture is not displaced.
    pub picture_from_keyframe: PictureMotion,
    /// Mapping in the other direction.
    keyframe_from_picture: PictureMotion,
    size: ImageSize,
}

impl View {
    /// Creates the view of a picture of this size.
    #[must_use]
    pub fn new(keyframe: Option<u64>, picture_from_keyframe: PictureMotion, size: ImageSize) -> Self {
        let keyframe_from_picture = picture_from_keyframe.inverse();
        Self { keyframe, reference: keyframe, picture_from_keyframe, keyframe_from_picture, size }
    }

    /// Creates the view of a picture that is displaced from no keyframe.
    #[must_use]
    pub fn at_rest(image: &RgbImage) -> Self {
        let size = ImageSize { width: image.width(), height: image.height() };
        Self::new(None, PictureMotion::IDENTITY, size)
    }

    /// Returns the distortion of the lens at half the picture's width (dimensionless).
    pub(crate) fn distortion(&self) -> f64 {
        self.picture_from_keyframe.lens.distortion(self.size)
    }

    /// Whether the picture is displaced from the keyframe.
    #[must_use]
    pub fn is_displaced(&self) -> bool {
        !self.picture_from_keyframe.is_identity()
    }

    /// Returns a box of the keyframe in pixels of the picture.
    #[must_use]
    pub fn in_picture(&self, bbox_px: &[f64; 4]) -> [f64; 4] {
        if self.is_displaced() { self.picture_from_keyframe.apply_to_box(bbox_px) } else { *bbox_px }
    }

    /// Returns a box of the picture in pixels of the keyframe.
    #[must_use]
    pub fn in_keyframe(&self, bbox_px: &[f64; 4]) -> [f64; 4] {
        if self.is_displaced() { self.keyframe_from_picture.apply_to_box(bbox_px) } else { *bbox_px }
    }

    /// Whether any part of a box lies in the picture, px.
    #[must_use]
    pub fn is_in_view(&self, [x0, y0, x1, y1]: &[f64; 4]) -> bool {
        let [_, _, width, height] = self.whole_px();
        *x1 > 0.0 && *y1 > 0.0 && *x0 < width && *y0 < height
    }

    /// Returns the whole picture as a box, px.
    fn whole_px(&self) -> [f64; 4] {
        [0.0, 0.0, f64::from(self.size.width), f64::from(self.size.height)]
    }

    /// Returns the part of a box that lies in the picture, px. `None` if it is less than half of the box.
    #[must_use]
    pub fn visible(&self, bbox_px: &[f64; 4]) -> Option<[f64; 4]> {
        let whole = self.whole_px();
        (bbox_share_inside(bbox_px, &whole) >= 0.5).then(|| bbox_inside(bbox_px, &whole))
    }

    /// Whether the picture shows a whole box of the keyframe. Only the part of the box inside the keyframe counts.
    #[must_use]
    pub fn shows(&self, bbox_px: &[f64; 4]) -> bool {
        let keyframe_px = self.size.picture_px();
        let [left, top, right, bottom] = keyframe_px;
        let [x0, y0, x1, y1] = self.in_picture(&bbox_inside(bbox_px, &keyframe_px));
        !self.is_displaced()
            || (x0 >= left - 1.0 && y0 >= top - 1.0 && x1 <= right + 1.0 && y1 <= bottom + 1.0)
    }

    /// Returns the parts of the picture that the keyframe does not show, px of the picture. Parts that are narrower than
    /// `least_px` are left out.
    #[must_use]
    pub fn new_parts(&self, least_px: f64) -> Vec<[f64; 4]> {
        let whole = self.size.picture_px();
        let [left, top, right, bottom] = whole;
        let [x0, y0, x1, y1] = self.in_picture(&whole);
        let parts = [
            [left, top, x0, bottom],
            [x1, top, right, bottom],
            [left, top, right, y0],
            [left, y1, right, bottom],
        ];
        parts.into_iter().filter(|[x0, y0, x1, y1]| x1 - x0 >= least_px && y1 - y0 >= least_px).collect()
    }

    /// Returns the reduced picture as it lies on the keyframe, by bilinear interpolation. Pixels that the picture does
    /// not show have the values of `outside`.
    #[must_use]
    pub fn laid(&self, small: &SmallGrey, outside: &SmallGrey) -> SmallGrey {
        if !self.is_displaced() {
            return small.clone();
        }
        let factor = small.factor as f64;
        // The middle of the top-left pixel of the frame is the origin of its coordinates.
        let in_frame = |point: Vector2<f64>| (point * factor).add_scalar(-0.5);
        let from = |point| self.picture_from_keyframe.apply(&in_frame(point)).add_scalar(0.5) / factor;
        let values: Vec<f32> = small.values.iter().map(|value| f32::from(*value)).collect();
        let size = (small.width, small.height);
        let laid = resampled(&values, size, from, |pixel| f32::from(outside.values[pixel]));
        SmallGrey { values: laid.into_iter().map(|value| value.round() as u8).collect(), ..*small }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::Homography;

    const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

    fn shifted(x: f64, y: f64) -> View {
        let by = Homography::from_numbers([1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0]).unwrap();
        View::new(Some(0), PictureMotion::new(by, roadplane_base::Lens::STRAIGHT, SIZE), SIZE)
    }

    #[test]
    fn parts_that_the_keyframe_lacks_are_new() {
        assert!(shifted(0.0, 0.0).new_parts(1.0).is_empty());
        let view = shifted(-30.0, 12.0);
        let [left, top, right, bottom] = SIZE.picture_px();
        assert_eq!(view.new_parts(20.0).len(), 1);
        let parts = view.new_parts(8.0);
        assert_eq!(parts, [[right - 30.0, top, right, bottom], [left, top, right, top + 12.0]]);
        assert!(view.shows(&[40.0, 0.0, 80.0, 40.0]) && !view.shows(&[20.0, 0.0, 60.0, 40.0]));
        assert_eq!(view.in_picture(&view.in_keyframe(&[5.0, 6.0, 7.0, 8.0])), [5.0, 6.0, 7.0, 8.0]);
    }

    #[test]
    fn a_displaced_picture_is_laid_on_the_keyframe() {
        let ramp = |shift: usize| {
            let values = (0..320 * 180).map(|i| ((i % 320 + 40 - shift) / 2) as u8).collect();
            SmallGrey { width: 320, height: 180, factor: 2, values }
        };
        // A shift of the frame by 8 px is one of the reduced picture by 4 px.
        let same = ramp(0);
        let laid = shifted(8.0, 0.0).laid(&ramp(4), &same);
        for y in [0, 90, 179] {
            assert_eq!(laid.row(y), same.row(y));
        }
    }
}
