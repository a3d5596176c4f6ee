//! Truth of rendered and real scenes: `roadplane.dataset/1` and `roadplane.truth/1`. Frames and units as in `base`.

#[cfg(any(test, feature = "fixture"))]
pub mod fixture;
mod read;

use std::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{Activity, Camera, GroundPlane, ImageSize, KEYPOINTS, VehicleClass};
use serde::{Deserialize, Serialize};

pub use read::{read_dataset, read_truth};

/// Schema of `dataset.json`.
pub const DATASET_SCHEMA: &str = "roadplane.dataset/1";
/// Schema of a truth file.
pub const TRUTH_SCHEMA: &str = "roadplane.truth/1";

/// 4 × 4 rows of a rigid motion.
pub type Rows = [[f64; 4]; 4];

/// `dataset.json`: what belongs to a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dataset {
    /// [`DATASET_SCHEMA`].
    pub schema: String,
    /// Its name.
    pub name: String,
    /// `eval`, `train` …
    pub split: String,
    /// What it was made from.
    pub seed: u64,
    /// Truth files, sorted, relative to the folder of `dataset.json`.
    pub items: Vec<PathBuf>,
}

/// One truth file: a still or a clip with one camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// [`TRUTH_SCHEMA`].
    pub schema: String,
    /// Image or video beside the truth file; none where there is only geometry.
    pub media: Option<PathBuf>,
    /// Still or clip.
    pub kind: Kind,
    /// Frames a second of a clip.
    pub fps: Option<f64>,
    /// Of the real world (or rendered).
    pub real: bool,
    /// Layout, weather … in words.
    #[serde(default)]
    pub conditions: BTreeMap<String, String>,
    /// The camera and the ground.
    pub camera: TrueCamera,
    /// The cars that appear, by id.
    pub models: Vec<Model>,
    /// The frames, in order.
    pub frames: Vec<TrueFrame>,
}

/// Still or clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// One picture.
    Still,
    /// A video.
    Clip,
}

/// Camera and ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueCamera {
    /// Width and height, px.
    pub image_size_px: ImageSize,
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, px.
    pub principal_point_px: [f64; 2],
    /// Camera above the ground, m.
    pub height_m: f64,
    /// Optical axis below the horizontal, rad.
    pub tilt_rad: f64,
    /// Clockwise turn of the horizon in the image, rad.
    pub roll_rad: f64,
    /// The ground in the camera frame.
    pub plane_in_camera: TruePlane,
    /// 4 × 4 rows.
    pub camera_from_world: Rows,
}

/// `normal · X + offset = 0`, normal pointing up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruePlane {
    /// Unit normal, camera frame.
    pub normal: [f64; 3],
    /// Camera above the plane, m.
    pub offset_m: f64,
}

/// One physical car.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Its number in this item.
    pub id: u64,
    /// What kind of vehicle it is.
    pub class: VehicleClass,
    /// `sedan`, `suv` …
    pub body: String,
    /// Name of the 3D model.
    pub model: String,
    /// Length, width, height, m.
    pub dims_m: [f64; 3],
    /// Keypoints in the car frame, m; those that the car lacks are null.
    pub keypoints_in_car: Vec<Option<[f64; 3]>>,
}

/// One frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueFrame {
    /// Its index.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Cars of which at least 15 % can be seen.
    pub cars: Vec<TrueCar>,
}

/// One car in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueCar {
    /// Which [`Model`].
    pub id: u64,
    /// 4 × 4 rows.
    pub world_from_car: Rows,
    /// Speed over ground, negative when reversing, m/s.
    pub speed_mps: f64,
    /// What it does.
    pub activity: Activity,
    /// Its visible part: left, top, right, bottom, px.
    #[serde(rename = "box")]
    pub bbox_px: [f64; 4],
    /// All of it, px; may reach out of the picture.
    #[serde(rename = "whole_box")]
    pub whole_bbox_px: [f64; 4],
    /// Share of its pixels that is seen, 0–1.
    pub visible_share: f64,
    /// x, y (px) and whether it is visible (0 or 1); null where the car lacks it or it lies behind the camera.
    pub keypoints_px: Vec<Option<[f64; 3]>>,
}

impl TrueCamera {
    /// The camera.
    #[must_use]
    pub fn camera(&self) -> Camera {
        Camera::pinhole(self.focal_px, Vector2::from(self.principal_point_px))
    }

    /// The ground.
    #[must_use]
    pub fn plane(&self) -> GroundPlane {
        GroundPlane {
            normal_in_camera: Vector3::from(self.plane_in_camera.normal),
            height_m: self.plane_in_camera.offset_m,
        }
    }

    /// The rigid motion from a car to the camera.
    #[must_use]
    pub fn camera_from_car(&self, car: &TrueCar) -> Isometry3<f64> {
        isometry_from_rows(&self.camera_from_world) * isometry_from_rows(&car.world_from_car)
    }
}

impl TrueCar {
    /// The rigid motion from the car to the world.
    #[must_use]
    pub fn world_from_car(&self) -> Isometry3<f64> {
        isometry_from_rows(&self.world_from_car)
    }
}

impl Model {
    /// The keypoints that the car has, car frame, by index.
    #[must_use]
    pub fn keypoints(&self) -> [Option<Point3<f64>>; KEYPOINTS] {
        std::array::from_fn(|i| self.keypoints_in_car.get(i).copied().flatten().map(Point3::from))
    }
}

impl Truth {
    /// The car with this id.
    #[must_use]
    pub fn model(&self, id: u64) -> Option<&Model> {
        self.models.iter().find(|model| model.id == id)
    }
}

/// The rigid motion of 4 × 4 rows whose upper left is a rotation (files round it to 1e-6).
#[must_use]
pub fn isometry_from_rows(rows: &Rows) -> Isometry3<f64> {
    let rotation = Matrix3::from_fn(|r, c| rows[r][c]);
    Isometry3::from_parts(
        Translation3::new(rows[0][3], rows[1][3], rows[2][3]),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
    )
}
