//! Options of a scene, and the scene with its ground truth.

use nalgebra::Vector3;
use roadplane_base::{CameraParams, GroundPose, ImageSize, KEYPOINTS, KeypointSet, Shape};

use crate::models::CarModel;

/// Layout of the cars of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Random positions and headings.
    Random,
    /// Side by side in rows, with headings along one axis (in both directions).
    Rows,
    /// All in one row across the view, with the same heading.
    OneRow,
    /// Random positions, all with the same heading.
    Parallel,
}

/// Error of a wholly wrong car.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// Keypoints scattered over the box.
    Scattered,
    /// The keypoints of a car in another pose, which is not on the plane.
    OtherPose,
    /// Left and right swapped, as by a net that confuses front and back.
    Mirrored,
}

/// Options of a scene. Ranges are [low, high].
#[derive(Clone, Debug)]
pub struct SynthOptions {
    /// Width and height of the image, px.
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
    /// Layout of the cars.
    pub layout: Layout,
    /// Factor on the shape coefficients, whose sd is 1. With 0, every car is the mean car.
    pub shape_sd: f64,
    /// Cars to draw from instead of the atlas; the atlas is used if this is empty.
    pub models: Vec<CarModel>,
    /// Factor on the residual of the first six modes: on fine modes, and on the rest per keypoint.
    ///
    /// Cars of the atlas are then drawn from the body types of traffic. With 0, cars have six normally distributed
    /// modes.
    pub off_atlas: f64,
    /// Share of the keypoints that are visible, 0–1. The keypoints that face the camera most are chosen.
    pub seen: f64,
    /// Noise sd as a share of the box's longer side.
    pub noise: f64,
    /// Share of gross outliers among the visible keypoints, 0–1.
    pub outliers: f64,
    /// Share of wholly wrong cars, 0–1 (rounded to whole cars).
    pub wrong_cars: f64,
    /// Kind of error of the wrong cars. With `None`, the cars get the three kinds in turn.
    pub wrong: Option<Wrong>,
    /// View error of a net that all cars share: two turns of each car, rad.
    ///
    /// The first turn is about the horizontal across the line of sight, as from another elevation. The second is about
    /// the line of sight.
    pub view_off: [f64; 2],
    /// sds of single cars about `view_off`, rad.
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

/// A car with its ground truth and measured keypoints.
#[derive(Clone, Debug)]
pub struct CarTruth {
    /// True pose on the plane.
    pub pose: GroundPose,
    /// True shape; the nearest shape of the atlas for a car that is not in the atlas.
    pub shape: Shape,
    /// True keypoints, car frame, m (with the residual that the atlas does not span).
    pub keypoints_in_car: [Vector3<f64>; KEYPOINTS],
    /// Measured keypoints.
    pub keypoints: KeypointSet,
    /// Whether each measured keypoint is a gross outlier.
    pub outlier: [bool; KEYPOINTS],
    /// Whether the car is wholly wrong.
    pub wrong: bool,
    /// Longer side of the car's box, px.
    pub box_px: f64,
}

/// A scene with its ground truth and measured keypoints.
#[derive(Clone, Debug)]
pub struct SceneTruth {
    /// Width and height of the image, px.
    pub size: ImageSize,
    /// Focal length and plane.
    pub params: CameraParams,
    /// Cars.
    pub cars: Vec<CarTruth>,
}

impl SceneTruth {
    /// Returns the measured keypoints of each car.
    pub fn keypoints(&self) -> impl Iterator<Item = &KeypointSet> {
        self.cars.iter().map(|car| &car.keypoints)
    }
}
