//! Truth files of rendered and real scenes: `roadplane.dataset/1` and `roadplane.truth/1`. Frames and units are those
//! of `base`.

#[cfg(any(test, feature = "fixture"))]
pub mod fixture;
mod read;

use std::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{Activity, Camera, GroundPlane, ImageSize, KEYPOINTS, VehicleClass};
use serde::{Deserialize, Serialize};

pub use read::{read_dataset, read_truth};

/// Schema id of `dataset.json`.
pub const DATASET_SCHEMA: &str = "roadplane.dataset/1";
/// Schema id of a truth file.
pub const TRUTH_SCHEMA: &str = "roadplane.truth/1";

/// A rigid motion as a 4 × 4 matrix, row by row.
pub type Rows = [[f64; 4]; 4];

/// `dataset.json`: the list of a data set's items.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dataset {
    /// Schema id: [`DATASET_SCHEMA`].
    pub schema: String,
    /// Name of the data set.
    pub name: String,
    /// Split: `eval`, `train` …
    pub split: String,
    /// Seed of the random numbers that the data set was made with.
    pub seed: u64,
    /// Truth files, sorted, relative to the folder of `dataset.json`.
    pub items: Vec<PathBuf>,
}

/// One truth file: a still or a clip with one camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Schema id: [`TRUTH_SCHEMA`].
    pub schema: String,
    /// Image or video beside the truth file; `None` if there is only geometry.
    pub media: Option<PathBuf>,
    /// Whether it is a still or a clip.
    pub kind: Kind,
    /// Frames per second of a clip.
    pub fps: Option<f64>,
    /// Whether the scene is real; otherwise it is rendered.
    pub real: bool,
    /// Conditions in words: layout, weather …
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

/// The true camera and the ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueCamera {
    /// Width and height, px.
    pub image_size_px: ImageSize,
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, px.
    pub principal_point_px: [f64; 2],
    /// Height of the camera above the ground, m.
    pub height_m: f64,
    /// Tilt: angle of the optical axis below the horizontal, rad.
    pub tilt_rad: f64,
    /// Roll: clockwise turn of the horizon in the image, rad.
    pub roll_rad: f64,
    /// The ground in the camera frame.
    pub plane_in_camera: TruePlane,
    /// Rigid motion from the world frame to the camera frame.
    pub camera_from_world: Rows,
}

/// The plane `normal · X + offset = 0`, with the normal pointing up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruePlane {
    /// Unit normal, camera frame.
    pub normal: [f64; 3],
    /// Height of the camera above the plane, m.
    pub offset_m: f64,
}

/// A physical car.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Id of the car in this item.
    pub id: u64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Body type: `sedan`, `suv` …
    pub body: String,
    /// Name of the 3D model.
    pub model: String,
    /// Length, width, height, m.
    pub dims_m: [f64; 3],
    /// Keypoints in the car frame, m; null for keypoints that the car lacks.
    pub keypoints_in_car: Vec<Option<[f64; 3]>>,
}

/// A frame of a truth file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueFrame {
    /// Index of the frame.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Cars of which at least 15 % is visible.
    pub cars: Vec<TrueCar>,
}

/// A car in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueCar {
    /// Id of its [`Model`].
    pub id: u64,
    /// Rigid motion from the car frame to the world frame.
    pub world_from_car: Rows,
    /// Speed over ground, m/s; negative when reversing.
    pub speed_mps: f64,
    /// Activity of the car.
    pub activity: Activity,
    /// Box of the visible part: left, top, right, bottom, px.
    #[serde(rename = "box")]
    pub bbox_px: [f64; 4],
    /// Box of the whole car, px; may extend beyond the picture.
    #[serde(rename = "whole_box")]
    pub whole_bbox_px: [f64; 4],
    /// Visible share of its pixels, 0–1.
    pub visible_share: f64,
    /// x, y (px) and visibility (0 or 1); null for keypoints that the car lacks or that lie behind the camera.
    pub keypoints_px: Vec<Option<[f64; 3]>>,
}

impl TrueCamera {
    /// Returns the pinhole camera.
    #[must_use]
    pub fn camera(&self) -> Camera {
        Camera::pinhole(self.focal_px, Vector2::from(self.principal_point_px))
    }

    /// Returns the ground plane.
    #[must_use]
    pub fn plane(&self) -> GroundPlane {
        GroundPlane {
            normal_in_camera: Vector3::from(self.plane_in_camera.normal),
            height_m: self.plane_in_camera.offset_m,
        }
    }

    /// Returns the rigid motion from a car to the camera.
    #[must_use]
    pub fn camera_from_car(&self, car: &TrueCar) -> Isometry3<f64> {
        isometry_from_rows(&self.camera_from_world) * isometry_from_rows(&car.world_from_car)
    }
}

impl TrueCar {
    /// Returns the rigid motion from the car to the world.
    #[must_use]
    pub fn world_from_car(&self) -> Isometry3<f64> {
        isometry_from_rows(&self.world_from_car)
    }
}

impl Model {
    /// Returns the keypoints of the car, car frame, by index; `None` for those that it lacks.
    #[must_use]
    pub fn keypoints(&self) -> [Option<Point3<f64>>; KEYPOINTS] {
        std::array::from_fn(|i| self.keypoints_in_car.get(i).copied().flatten().map(Point3::from))
    }
}

impl Truth {
    /// Returns the car with this id.
    #[must_use]
    pub fn model(&self, id: u64) -> Option<&Model> {
        self.models.iter().find(|model| model.id == id)
    }
}

/// Returns the rigid motion of 4 × 4 rows. Their upper left must be a rotation; files round it to 1e-6.
#[must_use]
pub fn isometry_from_rows(rows: &Rows) -> Isometry3<f64> {
    let rotation = Matrix3::from_fn(|r, c| rows[r][c]);
    Isometry3::from_parts(
        Translation3::new(rows[0][3], rows[1][3], rows[2][3]),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
    )
}
