//! Options of a synthetic scene, and the scene with its ground truth.

use nalgebra::Vector3;
use roadplane_base::{CameraParams, GroundPose, ImageSize, KEYPOINTS, KeypointSet, Shape};

use crate::models::CarModel;

/// Arrangement of the cars of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Random positions and headings.
    Random,
    /// Cars side by side in rows. Headings are along one axis, in both directions.
    Rows,
    /// All cars in one row across the view, with the same heading.
    OneRow,
    /// Random positions, all with the same heading.
    Parallel,
}

/// Kind of error of a car whose keypoints are all wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// Keypoints at random positions in the car's box.
    Scattered,
    /// Keypoints of the car in another pose, which is not on the ground plane.
    OtherPose,
    /// Left and right keypoints swapped. A net makes this error if it confuses front and back.
    Mirrored,
}

/// Options of a scene. Ranges have the form [low, high].
#[derive(Clone, Debug)]
pub struct SynthOptions {
    /// Width and height of the image, px.
    pub size: ImageSize,
    /// Number of cars.
    pub cars: usize,
    /// Range of the focal length, in units of the image width. The focal length is drawn log-uniformly.
    pub focal_ratio: [f64; 2],
    /// Range of the camera's height above the ground, m.
    pub height_m: [f64; 2],
    /// Range of the camera's tilt, rad. The tilt is the angle below the horizontal.
    pub tilt: [f64; 2],
    /// Range of the camera's roll, rad.
    pub roll: [f64; 2],
    /// Range of the longer side of a car's box, px.
    pub box_px: [f64; 2],
    /// Arrangement of the cars.
    pub layout: Layout,
    /// Factor on the random shape coefficients, whose sd is 1. With 0, every car has the mean shape.
    pub shape_sd: f64,
    /// Car models to draw the cars from. If the list is empty, the cars are drawn from the shape atlas.
    pub models: Vec<CarModel>,
    /// Factor on the shape details that the first six shape modes do not describe: the finer modes, and a residual per
    /// keypoint.
    ///
    /// With a factor above 0, the shapes follow the mixture of body types in traffic. With 0, the cars have six modes
    /// with normally distributed coefficients.
    pub off_atlas: f64,
    /// Share of a car's keypoints that are visible, 0–1. The visible keypoints are those that face the camera most.
    pub seen: f64,
    /// Sd of the keypoint noise, as a share of the longer side of the car's box.
    pub noise: f64,
    /// Share of gross outliers among the visible keypoints, 0–1.
    pub outliers: f64,
    /// Share of cars whose keypoints are all wrong, 0–1. The number of such cars is rounded.
    pub wrong_cars: f64,
    /// Kind of error of the wrong cars. With `None`, the wrong cars have the three kinds in turn.
    pub wrong: Option<Wrong>,
    /// Mean view error of all cars: two angles by which each car appears rotated, rad. A keypoint net can have such an
    /// error.
    ///
    /// The first rotation is about the horizontal axis across the line of sight. This rotation shows the car from
    /// another elevation. The second rotation is about the line of sight.
    pub view_off: [f64; 2],
    /// Sds of the view errors of single cars around `view_off`, rad.
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
    /// True shape. For a car that is not in the atlas, it is the nearest shape of the atlas.
    pub shape: Shape,
    /// True keypoints, car frame, m. They include the residual that the shape modes of the atlas do not describe.
    pub keypoints_in_car: [Vector3<f64>; KEYPOINTS],
    /// Measured keypoints of the car.
    pub keypoints: KeypointSet,
    /// Whether each measured keypoint is a gross outlier.
    pub outlier: [bool; KEYPOINTS],
    /// Whether all measured keypoints of the car are wrong.
    pub wrong: bool,
    /// Longer side of the car's box, px.
    pub box_px: f64,
}

/// A scene with its ground truth and measured keypoints.
#[derive(Clone, Debug)]
pub struct SceneTruth {
    /// Width and height of the image, px.
    pub size: ImageSize,
    /// Focal length and ground plane.
    pub params: CameraParams,
    /// Cars of the scene.
    pub cars: Vec<CarTruth>,
}

impl SceneTruth {
    /// Returns the measured keypoints of each car.
    pub fn keypoints(&self) -> impl Iterator<Item = &KeypointSet> {
        self.cars.iter().map(|car| &car.keypoints)
    }
}
