//! The 36 semantic keypoints of a car; names, mirror pairs and skeleton come from `models/keypoints.json`.

use std::sync::LazyLock;

use nalgebra::{Matrix2, Vector2};
use serde::Deserialize;

/// Number of keypoints of a car: 18 on its own left side, then their 18 mirror images on its right side.
pub const KEYPOINTS: usize = 36;

/// Least number of usable keypoints for a pose: enough for position and heading, and some to check the fit.
pub const MIN_KEYPOINTS: usize = 5;

/// A keypoint with its location in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Location, px.
    pub pixel: Vector2<f64>,
    /// Probability that the keypoint is visible, 0–1.
    pub score: f64,
    /// Covariance of the location, px².
    pub covariance_px2: Matrix2<f64>,
}

impl Keypoint {
    /// Creates a keypoint with the same sd (px) in all directions.
    #[must_use]
    pub fn isotropic(pixel: Vector2<f64>, score: f64, sd_px: f64) -> Self {
        Self { pixel, score, covariance_px2: Matrix2::identity() * (sd_px * sd_px) }
    }

    /// Returns the root mean square of the sd over directions, px.
    #[must_use]
    pub fn sd_px(&self) -> f64 {
        (self.covariance_px2.trace() / 2.0).max(0.0).sqrt()
    }
}

/// Keypoints of one car by index; `None` for those that were not located.
pub type KeypointSet = [Option<Keypoint>; KEYPOINTS];

#[derive(Deserialize)]
struct KeypointFile {
    names: Vec<String>,
    mirror: Vec<usize>,
    edges: Vec<[usize; 2]>,
}

// Compiled in and checked by the test below, so it cannot fail at run time.
static FILE: LazyLock<KeypointFile> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../../../models/keypoints.json")).unwrap_or(KeypointFile {
        names: Vec::new(),
        mirror: Vec::new(),
        edges: Vec::new(),
    })
});

/// Returns the keypoints' names by index, such as `left_wheel_front`.
#[must_use]
pub fn keypoint_names() -> &'static [String] {
    &FILE.names
}

/// Returns the index of the mirror image of a keypoint, on the car's other side.
#[must_use]
pub fn mirror_index(index: usize) -> usize {
    FILE.mirror.get(index).copied().unwrap_or(index)
}

/// Returns the edges of the wireframe as pairs of keypoint indices.
#[must_use]
pub fn skeleton_edges() -> &'static [[usize; 2]] {
    &FILE.edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_data_file_is_whole() {
        assert_eq!(keypoint_names().len(), KEYPOINTS);
        assert_eq!(keypoint_names()[0], "left_wheel_front");
        assert!(!skeleton_edges().is_empty());
        for [a, b] in skeleton_edges() {
            assert!(*a < KEYPOINTS && *b < KEYPOINTS);
        }
        for (i, name) in keypoint_names().iter().enumerate() {
            let other = mirror_index(i);
            assert_eq!(mirror_index(other), i);
            let swapped = match name.strip_prefix("left_") {
                Some(rest) => format!("right_{rest}"),
                None => name.replace("right_", "left_"),
            };
            assert_eq!(keypoint_names()[other], swapped);
        }
    }
}
