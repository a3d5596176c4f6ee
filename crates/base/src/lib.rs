//! What every stage shares: camera, ground plane, poses, the shape atlas and the records that flow between stages.
//! This crate does no I/O.
//!
//! # Frames (right-handed, metres)
//! | frame | axes | origin |
//! |---|---|---|
//! | camera | x right, y down, z forward | optical centre |
//! | pixel | x right, y down | centre of the top-left pixel |
//! | world | z up (plane normal), y the viewing direction laid on the plane, x right | plane point under the camera |
//! | car | x forward, y left, z up | on the ground midway between the axles |
//!
//! Transforms are named `target_from_source`. SI units and radians; suffixes where a unit is not obvious.

mod activity;
mod assign;
mod atlas;
mod bbox;
mod camera;
mod clue;
mod evidence;
mod frame;
mod keypoint;
mod lens;
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
pub use bbox::{bbox_around, bbox_centre, bbox_covered, bbox_iou, bbox_moved, bbox_share_inside};
pub use camera::{Camera, CameraParams, ImageSize};
pub use clue::{Clue, ClueTerms};
pub use evidence::{CameraEvidence, ClipIdentity, EVIDENCE_SCHEMA, ParkedCar};
pub use frame::{Frame, FrameStamp};
pub use keypoint::{KEYPOINTS, Keypoint, KeypointSet, keypoint_names, mirror_index, skeleton_edges};
pub use lens::Lens;
pub use plane::GroundPlane;
pub use pose::{GroundPose, angle_difference, wrap_angle};
pub use records::{
    CameraEstimate, CameraMove, CameraStatus, CarRecord, CarRef, FrameRecord, MoveKind, OnMap,
    PictureVerdict, PoseRecord, RecordError, TrackRow, VehicleClass, WatchRecord, rows_from_isometry,
};
pub use robust::{median, weighted_median};
pub use scene_line::{SceneCurve, SceneLine};
pub use shared::{JointInformation, SHARED_ERRORS, SharedSd};
pub use similarity::Similarity;
