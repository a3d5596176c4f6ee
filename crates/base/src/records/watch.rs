//! What the pictures themselves say of the camera: `watch` of a frames file.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a picture shows, as far as the camera is concerned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureVerdict {
    /// The camera is where it was, up to the shake that the offset tells.
    Rest,
    /// It is being turned or zoomed, or the pictures change from one to the next.
    Moving,
    /// Not as before; whether it is a move shows later.
    Unsettled,
    /// Nothing but black.
    Black,
    /// Nothing but white.
    White,
    /// Something lies over the lens: no structure left.
    Covered,
    /// The same picture again and again, where there was noise before.
    Frozen,
    /// Too little structure to tell.
    #[default]
    Unknown,
}

impl PictureVerdict {
    /// Nothing can be seen in the picture.
    #[must_use]
    pub fn is_blind(self) -> bool {
        matches!(self, Self::Black | Self::White | Self::Covered)
    }
}

/// What the picture itself says, before any vehicle is looked for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchRecord {
    /// Whether this frame's picture was looked at; otherwise verdict and offset are those of the last one that was, and only
    /// vehicles that are held are listed.
    pub looked: bool,
    /// What it shows.
    pub verdict: PictureVerdict,
    /// Where the picture of the place lies against its place at rest, px: right, down. What is seen at `p` would be at
    /// `p − offset` without the shake.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset_px: [f64; 2],
    /// In this frame it became known that the camera was moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<CameraMove>,
    /// Share of the picture that is not as it was when the detector last looked there, 0–1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changed: Option<f64>,
    /// Share of the picture that the detector looked at in this frame, 0–1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<f64>,
}

fn is_zero(offset_px: &[f64; 2]) -> bool {
    offset_px.iter().all(|v| v.abs() < f64::EPSILON)
}

/// How the camera came to another position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MoveKind {
    /// It was turned: the picture is shifted.
    Turned,
    /// It was zoomed.
    Zoomed,
    /// Another picture altogether: nothing of the camera before holds.
    Cut,
    /// It began to move and has not come to rest.
    Moving,
}

/// A change of the camera's position. It is told when it is known, which is later than it happened.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraMove {
    /// How.
    pub kind: MoveKind,
    /// First frame of the new position.
    pub since_frame: u64,
    /// Its time, s.
    pub since_s: f64,
    /// Shift of the picture, px, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift_px: Option<[f64; 2]>,
    /// Logarithm of the picture's growth, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_scale: Option<f64>,
}

impl WatchRecord {
    /// Shake of the picture, px: see [`Self::offset_px`].
    #[must_use]
    pub fn offset(&self) -> Vector2<f64> {
        Vector2::from(self.offset_px)
    }
}
