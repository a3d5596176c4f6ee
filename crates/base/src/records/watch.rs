//! State of the camera, computed from the pictures alone: the field `watch` of a frames file.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// State of the camera that one picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureVerdict {
    /// The camera has not moved, apart from the shake in `offset_px`.
    Rest,
    /// The camera turns or zooms, or each picture differs from the previous picture.
    Moving,
    /// The picture differs from the background image. Only later frames show whether the camera was moved.
    Unsettled,
    /// The picture is black.
    Black,
    /// The picture is white.
    White,
    /// The lens is covered: the picture has no structure.
    Covered,
    /// The same picture repeats exactly, without the noise of earlier pictures.
    Frozen,
    /// The picture has too little structure to determine the state.
    #[default]
    Unknown,
}

impl PictureVerdict {
    /// Whether the picture shows nothing of the scene.
    #[must_use]
    pub fn is_blind(self) -> bool {
        matches!(self, Self::Black | Self::White | Self::Covered)
    }
}

/// State of the camera and change of the picture, computed before vehicles are detected.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchRecord {
    /// Whether this is an inference frame: a frame on which the nets ran. If false, `verdict` and `offset_px` are
    /// copied from the last inference frame. `cars` then lists only vehicles that are carried over from earlier frames.
    pub looked: bool,
    /// State of the camera that the picture shows.
    pub verdict: PictureVerdict,
    /// Shift of the picture by camera shake, px. Right and down are positive. Without shake, a point at pixel `p` would
    /// be at `p − offset_px`. Absent if zero.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset_px: [f64; 2],
    /// Camera move that was detected in this frame. It may have happened earlier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<CameraMove>,
    /// Share of the picture, 0 to 1, that has changed since the detector last ran on that part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0, max = 1))]
    pub changed: Option<f64>,
    /// Share of the picture on which the detector ran in this frame, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0, max = 1))]
    pub seen: Option<f64>,
    /// Whether the frame's vehicles were left out of the estimation, and why. It is not stored in files: `AtRest` of the
    /// crate `calibrate` sets it.
    #[serde(skip)]
    pub left_out: LeftOut,
}

/// The reason why the vehicles of a frame were left out of the estimation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LeftOut {
    /// They were not left out because of the camera's motion.
    #[default]
    No,
    /// The camera moved.
    Moved,
    /// The camera may have moved. The clip ended before this could be decided.
    MayHaveMoved,
}

fn is_zero(offset_px: &[f64; 2]) -> bool {
    offset_px.iter().all(|v| v.abs() < f64::EPSILON)
}

/// The kind of a camera move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MoveKind {
    /// The camera was turned: the picture is shifted.
    Turned,
    /// The camera was zoomed: the picture is scaled.
    Zoomed,
    /// The picture shows another scene, so the camera estimated before is no longer valid.
    Cut,
    /// The camera began to move and has not come to rest.
    Moving,
}

/// A camera move. It is reported in the frame in which it is detected, which is later than the move itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraMove {
    /// Kind of the move.
    pub kind: MoveKind,
    /// Index of the first frame after the move, from 0.
    pub since_frame: u64,
    /// Presentation time of the frame `since_frame`, s.
    pub since_s: f64,
    /// Shift of the picture by the move, px. Right and down are positive. Absent if it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift_px: Option<[f64; 2]>,
    /// Natural logarithm of the magnification of the picture by the move. Absent if it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_scale: Option<f64>,
}

impl WatchRecord {
    /// Returns the shift of the picture by camera shake, px: [`Self::offset_px`] as a vector.
    #[must_use]
    pub fn offset(&self) -> Vector2<f64> {
        Vector2::from(self.offset_px)
    }
}
