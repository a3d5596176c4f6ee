//! Scenes as they are asked for, and with their truth.

use nalgebra::Vector3;
use roadplane_base::{CameraParams, GroundPose, ImageSize, KEYPOINTS, KeypointSet, Shape};

use crate::models::CarModel;

/// How cars stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Anywhere, any heading.
    Random,
    /// Side by side in rows, headings of one axis (either way).
    Rows,
    /// All in one row across the view, the same heading.
    OneRow,
    /// Anywhere, all with the same heading.
    Parallel,
}

/// How a wholly wrong car is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// Keypoints scattered over the box.
    Scattered,
    /// The keypoints of a car in another pose, not standing on the plane.
    OtherPose,
    /// Left and right swapped: what a net sees that mistakes the front for the back.
    Mirrored,
}

/// What to make. Ranges are [low, high].
#[derive(Clone, Debug)]
pub struct SynthOptions {
    /// Image size.
    pub size: ImageSize,
    /// Number of cars.
    pub cars: usize,
    /// Focal length in units of the image width (drawn log-uniformly).
    pub focal_ratio: [f64; 2],
    /// Camera height, m.
    pub height_m: [f64; 2],
    /// Tilt, rad.
    pub tilt: [f64; 2],
    /// Roll, rad.
    pub roll: [f64; 2],
    /// Longer side of a car's box, px.
    pub box_px: [f64; 2],
    /// How cars stand.
    pub layout: Layout,
    /// Factor on the shape coefficients, whose sd is 1; 0: every car is the mean car.
    pub shape_sd: f64,
    /// Cars to draw from instead of the atlas; empty: the atlas.
    pub models: Vec<CarModel>,
    /// Factor on what six modes leave unexplained (fine modes, and the rest per keypoint): cars that they do not span, of the
    /// body types of traffic, if they are the atlas'. 0: cars of six modes, normally distributed, all of one kind.
    pub off_atlas: f64,
    /// Share of keypoints seen (those that face the camera first).
    pub seen: f64,
    /// Noise sd as a share of the box's longer side.
    pub noise: f64,
    /// Share of gross outliers among the seen keypoints.
    pub outliers: f64,
    /// Share of wholly wrong cars (rounded to whole cars).
    pub wrong_cars: f64,
    /// How they are wrong; `None`: each kind in turn.
    pub wrong: Option<Wrong>,
    /// How far off a net sees all cars: as if each were turned by so much about the horizontal across the line of sight (seen from
    /// another elevation), and about the line of sight, rad.
    pub view_off: [f64; 2],
    /// How cars scatter about that, sds, rad.
    pub view_sd: [f64; 2],
}

impl Default for SynthOptions {
    fn default() -> Self {
        Self {
            size: ImageSize { width: 1920, height: 1080 },
            cars: 10,
            focal_ratio: [0.6, 4.0],
            height_m: [4.0, 30.0],
            tilt: [5_f64.to_radians(), 50_f64.to_radians()],
            roll: [-5_f64.to_radians(), 5_f64.to_radians()],
            box_px: [50.0, 700.0],
            layout: Layout::Random,
            shape_sd: 1.0,
            models: Vec::new(),
            off_atlas: 0.0,
            seen: 0.6,
            noise: 0.01,
            outliers: 0.0,
            wrong_cars: 0.0,
            wrong: None,
            view_off: [0.0; 2],
            view_sd: [0.0; 2],
        }
    }
}

/// A car with truth.
#[derive(Clone, Debug)]
pub struct CarTruth {
    /// Where it stands.
    pub pose: GroundPose,
    /// Its shape; of a car that is not the atlas', the nearest one.
    pub shape: Shape,
    /// Its keypoints, car frame, m (with what the atlas does not span).
    pub keypoints_in_car: [Vector3<f64>; KEYPOINTS],
    /// What was measured.
    pub keypoints: KeypointSet,
    /// Which measured keypoints are gross outliers.
    pub outlier: [bool; KEYPOINTS],
    /// Wholly wrong.
    pub wrong: bool,
    /// Longer side of its box, px.
    pub box_px: f64,
}

/// A scene with truth.
#[derive(Clone, Debug)]
pub struct SceneTruth {
    /// Image size.
    pub size: ImageSize,
    /// Focal length and plane.
    pub params: CameraParams,
    /// Cars.
    pub cars: Vec<CarTruth>,
}

impl SceneTruth {
    /// The measured keypoints, car by car.
    pub fn keypoints(&self) -> impl Iterator<Item = &KeypointSet> {
        self.cars.iter().map(|car| &car.keypoints)
    }
}
