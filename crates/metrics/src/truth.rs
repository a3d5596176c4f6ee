//! Truth files of rendered and real scenes (schemas `roadplane.dataset/1` and `roadplane.truth/1`). Coordinate frames
//! and units are those of the crate `base`.

#[cfg(any(test, feature = "fixture"))]
pub mod fixture;
mod read;

use std::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use roadplane_base::{Activity, Camera, GroundPlane, ImageSize, KEYPOINTS, VehicleClass};
use serde::{Deserialize, Serialize};

pub use read::{read_dataset, read_truth, scene_name};

/// Schema id of `dataset.json`.
pub const DATASET_SCHEMA: &str = "roadplane.dataset/1";
/// Schema id of a truth file.
pub const TRUTH_SCHEMA: &str = "roadplane.truth/1";

/// A rigid motion as a 4 × 4 matrix, row by row.
pub type Rows = [[f64; 4]; 4];

/// The file `dataset.json`: the list of the truth files in a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dataset {
    /// Schema id: [`DATASET_SCHEMA`].
    pub schema: String,
    /// Name of the data set.
    pub name: String,
    /// Split of the data set: `eval`, `train` …
    pub split: String,
    /// Seed of the random numbers that generated the data set.
    pub seed: u64,
    /// Truth files, sorted, relative to the folder of `dataset.json`.
    pub items: Vec<PathBuf>,
}

/// One truth file: a still or a clip with one camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Schema id: [`TRUTH_SCHEMA`].
    pub schema: String,
    /// Image or video of the scene. `None` if the scene has geometry only.
    pub media: Option<PathBuf>,
    /// Whether the scene is a still or a clip.
    pub kind: Kind,
    /// Frames per second of a clip.
    pub fps: Option<f64>,
    /// Whether the scene is real. All other scenes are rendered.
    pub real: bool,
    /// Conditions of the scene in words: layout, weather …
    #[serde(default)]
    pub conditions: BTreeMap<String, String>,
    /// The camera and the ground. A camera that turns has this pose in its first frame.
    pub camera: TrueCamera,
    /// The physical cars of the scene.
    pub models: Vec<Model>,
    /// The frames, in order.
    pub frames: Vec<TrueFrame>,
}

/// The kind of a scene: a still or a clip.
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
    /// Width and height of the picture, px.
    pub image_size_px: ImageSize,
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, px.
    pub principal_point_px: [f64; 2],
    /// Height of the camera above the ground, m.
    pub height_m: f64,
    /// Tilt: angle of the optical axis below the horizontal, rad.
    pub tilt_rad: f64,
    /// Roll: clockwise rotation of the horizon in the image, rad.
    pub roll_rad: f64,
    /// The ground plane in the camera frame.
    pub plane_in_camera: TruePlane,
    /// Rigid motion from the world frame to the camera frame, m.
    pub camera_from_world: Rows,
}

/// The ground plane: all points X with `normal · X + offset = 0`. The normal points up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruePlane {
    /// Unit normal of the plane in the camera frame.
    pub normal: [f64; 3],
    /// Height of the camera above the plane, m.
    pub offset_m: f64,
}

/// A physical car of the scene: its class, dimensions and keypoints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Id of the car within the truth file.
    pub id: u64,
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Body type: `sedan`, `suv` …
    pub body: String,
    /// Name of the 3D model.
    pub model: String,
    /// Length, width, height, m.
    pub dims_m: [f64; 3],
    /// Keypoints of the car by index, car frame, m. The entry is null for a keypoint that the car lacks.
    pub keypoints_in_car: Vec<Option<[f64; 3]>>,
}

/// A frame of a truth file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueFrame {
    /// Index of the frame.
    pub frame: u64,
    /// Time of the frame in the clip, s.
    pub time_s: f64,
    /// Cars with at least 15 % of their pixels visible.
    pub cars: Vec<TrueCar>,
    /// Homography from pixels of [`Truth::camera`] to pixels of this frame, if the camera turns or zooms: the first
    /// eight numbers of the matrix, row by row. The ninth is 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture_from_world: Option<[f64; 8]>,
}

/// A car in one frame of a truth file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueCar {
    /// Id of its [`Model`].
    pub id: u64,
    /// Rigid motion from the car frame to the world frame, m.
    pub world_from_car: Rows,
    /// Speed over ground, m/s; negative when reversing.
    pub speed_mps: f64,
    /// Activity of the car.
    pub activity: Activity,
    /// Box of the visible part: left, top, right, bottom, px.
    #[serde(rename = "box")]
    pub bbox_px: [f64; 4],
    /// Box of the whole car: left, top, right, bottom, px. The box may extend beyond the picture.
    #[serde(rename = "whole_box")]
    pub whole_bbox_px: [f64; 4],
    /// Visible share of the car's pixels, 0–1.
    pub visible_share: f64,
    /// Keypoints by index: x (px), y (px) and visibility (0 or 1). The entry is null for a keypoint that the car lacks,
    /// or that lies behind the camera.
    pub keypoints_px: Vec<Option<[f64; 3]>>,
}

impl TrueCamera {
    /// Returns the camera as a pinhole camera without distortion.
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

    /// Returns the rigid motion from the car frame to the camera frame, m.
    #[must_use]
    pub fn camera_from_car(&self, car: &TrueCar) -> Isometry3<f64> {
        isometry_from_rows(&self.camera_from_world) * isometry_from_rows(&car.world_from_car)
    }
}

impl TrueCar {
    /// Returns the rigid motion from the car frame to the world frame, m.
    #[must_use]
    pub fn world_from_car(&self) -> Isometry3<f64> {
        isometry_from_rows(&self.world_from_car)
    }
}

impl Model {
    /// Returns the keypoints of the car by index, car frame, m. The entry is `None` for a keypoint that the car lacks.
    #[must_use]
    pub fn keypoints(&self) -> [Option<Point3<f64>>; KEYPOINTS] {
        std::array::from_fn(|i| self.keypoints_in_car.get(i).copied().flatten().map(Point3::from))
    }
}

impl Truth {
    /// Returns the physical car with this id, if there is one.
    #[must_use]
    pub fn model(&self, id: u64) -> Option<&Model> {
        self.models.iter().find(|model| model.id == id)
    }
}

/// Returns the rigid motion that a 4 × 4 matrix describes. The upper left 3 × 3 part must be a rotation; files round
/// its values to 1e-6.
#[must_use]
pub fn isometry_from_rows(rows: &Rows) -> Isometry3<f64> {
    let rotation = Matrix3::from_fn(|r, c| rows[r][c]);
    Isometry3::from_parts(
        Translation3::new(rows[0][3], rows[1][3], rows[2][3]),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
    )
}
