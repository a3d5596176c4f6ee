//! The 36 semantic keypoints of a car; names, mirror pairs and skeleton come from `models/keypoints.json`.

use std::sync::LazyLock;

use nalgebra::{Matrix2, Vector2};
use serde::Deserialize;

/// How many keypoints a car has: 18 on its own left side, then the same 18 on its right.
pub const KEYPOINTS: usize = 36;

/// Usable ones that a car needs at least: place, heading or turn, and something to check them by.
pub const MIN_KEYPOINTS: usize = 5;

/// A located keypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Where it is, px.
    pub pixel: Vector2<f64>,
    /// Probability that it is visible, 0–1.
    pub score: f64,
    /// Covariance of the location, px².
    pub covariance_px2: Matrix2<f64>,
}

impl Keypoint {
    /// A keypoint with the same sd in all directions.
    #[must_use]
    pub fn isotropic(pixel: Vector2<f64>, score: f64, sd_px: f64) -> Self {
        Self { pixel, score, covariance_px2: Matrix2::identity() * (sd_px * sd_px) }
    }

    /// Root mean square of the sd over directions, px.
    #[must_use]
    pub fn sd_px(&self) -> f64 {
        (self.covariance_px2.trace() / 2.0).max(0.0).sqrt()
    }
}

/// What was found of a car, by keypoint index.
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

/// Names such as `left_wheel_front`, by index.
#[must_use]
pub fn keypoint_names() -> &'static [String] {
    &FILE.names
}

/// The same point on the car's other side.
#[must_use]
pub fn mirror_index(index: usize) -> usize {
    FILE.mirror.get(index).copied().unwrap_or(index)
}

/// Pairs of keypoints that a wireframe joins.
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
