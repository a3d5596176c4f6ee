//! The 36 semantic keypoints of a car.
//!
//! Their names, mirror pairs and skeleton edges come from `models/keypoints.json`.

use std::sync::LazyLock;

use nalgebra::{Matrix2, Vector2};
use serde::Deserialize;

/// Number of keypoints of a car: 18 on the car's left side, then their 18 mirror images on the right side.
pub const KEYPOINTS: usize = 36;

/// Smallest number of usable keypoints from which a pose is estimated.
///
/// Position and heading need fewer keypoints. The additional keypoints check the fit.
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

    /// Returns the sd of the location, px: the root mean square over all directions.
    #[must_use]
    pub fn sd_px(&self) -> f64 {
        (self.covariance_px2.trace() / 2.0).max(0.0).sqrt()
    }
}

/// Keypoints of one car by index. An entry is `None` if the keypoint was not located.
pub type KeypointSet = [Option<Keypoint>; KEYPOINTS];

#[derive(Deserialize)]
struct KeypointFile {
    names: Vec<String>,
    mirror: Vec<usize>,
    edges: Vec<[usize; 2]>,
}

// The file is compiled in, and the test below checks it. So reading it cannot fail at run time.
static FILE: LazyLock<KeypointFile> = LazyLock::new(|| {
    serde_json::from_str(include_str!("../../../models/keypoints.json")).unwrap_or(KeypointFile {
        names: Vec::new(),
        mirror: Vec::new(),
        edges: Vec::new(),
    })
});

/// Returns the names of the keypoints by index, such as `left_wheel_front`.
#[must_use]
pub fn keypoint_names() -> &'static [String] {
    &FILE.names
}

/// Returns the index of the corresponding keypoint on the other side of the car.
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
