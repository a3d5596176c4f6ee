//! Width and height of an image.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::PictureMotion;

/// Width and height of an image, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(into = "[u32; 2]", from = "[u32; 2]")]
pub struct ImageSize {
    /// Width (columns), px.
    pub width: u32,
    /// Height (rows), px.
    pub height: u32,
}

impl From<[u32; 2]> for ImageSize {
    fn from([width, height]: [u32; 2]) -> Self {
        Self { width, height }
    }
}

impl From<ImageSize> for [u32; 2] {
    fn from(size: ImageSize) -> Self {
        [size.width, size.height]
    }
}

impl ImageSize {
    /// Returns the middle of the image, px. The middle is the assumed principal point if none is given.
    #[must_use]
    pub fn centre_px(self) -> Vector2<f64> {
        Vector2::new((f64::from(self.width) - 1.0) / 2.0, (f64::from(self.height) - 1.0) / 2.0)
    }

    /// Returns the whole image as a box, px: left, top, right, bottom.
    #[must_use]
    pub fn picture_px(self) -> [f64; 4] {
        [-0.5, -0.5, f64::from(self.width) - 0.5, f64::from(self.height) - 0.5]
    }

    /// Returns the part of the world picture that an image of a moving camera shows, as a box, px. Without a mapping it is
    /// the whole image.
    #[must_use]
    pub fn part_in_view_px(self, picture_from_world: Option<&PictureMotion>) -> [f64; 4] {
        let whole = self.picture_px();
        picture_from_world.map_or(whole, |mapping| mapping.inverse().apply_to_box(&whole))
    }
}
