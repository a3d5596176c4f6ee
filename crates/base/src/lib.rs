//! The types that all stages share: camera, ground plane, poses, the shape atlas and the records between stages.
//! This crate does no I/O.
//!
//! # Frames (right-handed, metres)
//! | frame | axes | origin |
//! |---|---|---|
//! | camera | x right, y down, z forward | optical centre |
//! | pixel | x right, y down | centre of the top-left pixel |
//! | world | z up (normal of the ground plane), y forward (viewing direction projected onto the plane), x right | point of the plane below the camera |
//! | car | x forward, y left, z up | on the ground midway between the axles |
//!
//! The name of a transform is `target_from_source`: it converts source coordinates to target coordinates. Units are SI
//! units and radians. A suffix of a name, such as `_px`, gives a unit that is not obvious.
//!
//! # Contents
//! - the camera: [`Camera`], [`Lens`], [`GroundPlane`], [`CameraParams`], and its prior ([`CameraPrior`])
//! - the ground: one plane or two ([`Ground`]), with coordinates on the unfolded surface for tracks
//! - evidence on the camera: the information from cars, which can be summed over frames ([`JointInformation`])
//! - cars: [`ShapeAtlas`], [`GroundPose`], the 36 keypoints ([`KeypointSet`]), boxes (`bbox_…`), [`Activity`]
//! - records that stages exchange and files store: `records/`, [`CameraEvidence`], [`SceneLine`]
//! - small tools: [`assign`], [`median`], [`StudentT`], [`Similarity`], [`Homography`]
//!
//! # Example
//! The example computes the pixel of the front left wheel of a mean car:
//! ```
//! use nalgebra::Point3;
//! use roadplane_base::{Camera, GroundPlane, GroundPose, ImageSize, ShapeAtlas, keypoint_names};
//!
//! let atlas = ShapeAtlas::shipped()?;
//! let camera = Camera::centred(1400.0, ImageSize { width: 1920, height: 1080 });
//! let plane = GroundPlane::from_tilt_roll_height(0.4, 0.0, 8.0);
//! let car = GroundPose { x_m: 2.0, y_m: 18.0, heading_rad: 0.3 };
//! let wheel = keypoint_names().iter().position(|name| *name == "left_wheel_front").unwrap_or(0);
//! let in_camera = plane.camera_from_world() * car.world_from_car() * Point3::from(atlas.mean[wheel]);
//! let pixel = camera.pixel_from_camera(&in_camera.coords);
//! assert!(pixel.is_some_and(|pixel| pixel.x > 960.0));
//! # Ok::<(), roadplane_base::AtlasError>(())
//! ```

mod activity;
mod assign;
mod atlas;
mod bbox;
mod camera;
mod camera_params;
mod camera_prior;
mod evidence;
mod frame;
mod ground;
mod homography;
mod image_size;
mod interpolated;
mod keypoint;
mod lens;
mod picture_motion;
mod plane;
mod pose;
mod records;
mod robust;
mod scene_line;
mod shared;
mod similarity;

pub use activity::Activity;
pub use assign::assign;
pub use atlas::{
    ALL_MODES, ATLAS_SCHEMA, AtlasError, BodyType, FINE_MODES, FullShape, MODES, Shape, ShapeAtlas,
};
pub use bbox::{
    bbox_around, bbox_centre, bbox_covered, bbox_cut, bbox_foot, bbox_hidden_by, bbox_inside, bbox_iou,
    bbox_longer_side, bbox_mapped, bbox_moved, bbox_part, bbox_part_seen, bbox_share_inside,
};
pub use camera::Camera;
pub use camera_params::CameraParams;
pub use camera_prior::{CameraPrior, is_determined};
pub use evidence::{CameraEvidence, ClipIdentity, EVIDENCE_SCHEMA, ParkedCar};
pub use frame::{Frame, FrameStamp};
pub use ground::{Ground, GroundPart};
pub use homography::{Homography, Turn, bbox_grid};
pub use image_size::ImageSize;
pub use interpolated::interpolated;
pub use keypoint::{
    KEYPOINTS, Keypoint, KeypointSet, MIN_KEYPOINTS, keypoint_names, mirror_index, skeleton_edges,
};
pub use lens::Lens;
pub use picture_motion::PictureMotion;
pub use plane::GroundPlane;
pub use pose::{GroundPose, angle_difference, fold_axis, wrap_angle};
pub use records::{
    CameraEstimate, CameraMove, CameraStatus, CarRecord, CarRef, FrameRecord, MoveKind, NotFollowedReason,
    OnMap, PictureVerdict, PoseRecord, RecordError, RegisteredLens, Registration, SecondPlane, TrackRow,
    VehicleClass, WatchRecord, WeakBox, rows_from_isometry,
};
pub use robust::{StudentT, median, upper_median, weighted_median};
pub use scene_line::{SceneCurve, SceneLine};
pub use shared::{JointInformation, SHARED_ERRORS, SharedSd};
pub use similarity::Similarity;
