//! State of the camera, computed from the pictures alone: the field `watch` of a frames file.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Homography, ImageSize, Lens, PictureMotion};

/// State of the camera that one picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureVerdict {
    /// The camera has not moved, apart from the shake in `offset_px`.
    Rest,
    /// The camera turns or zooms, or each picture differs from the previous picture.
    Moving,
    /// The picture is displaced from the camera's position. Only later frames show whether the camera was moved.
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
    /// Motion of the camera: how the picture lies on the pictures of earlier frames, its references. The first entry is
    /// the most accurate. Further entries link references with each other. Absent if the picture lies on no reference.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motion: Vec<Registration>,
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
    /// Reason why the frame's vehicles were left out of the estimation; `None` if they were not. It is not stored in
    /// files: `OneCamera` of the crate `calibrate` sets it.
    #[serde(skip)]
    pub left_out: Option<NotFollowedReason>,
    /// Index of the place that the picture shows, from 0. A camera that returns to a place shows the same place again. It
    /// is not stored in files: `OneCamera` of the crate `calibrate` sets it.
    #[serde(skip)]
    pub place: Option<usize>,
    /// Mapping from pixels of the camera's first picture to pixels of this picture. Boxes and keypoints of a frame refer
    /// to the first picture where this is set. It is not stored in files: `OneCamera` of the crate `calibrate` sets it.
    #[serde(skip)]
    pub picture_from_world: Option<PictureMotion>,
}

/// Reason why the vehicles of a frame are not followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NotFollowedReason {
    /// The camera is carried along. Near and far parts of the scene then shift differently, so no rotation explains the
    /// motion.
    Travelling,
    /// The motion of the camera could not be measured.
    NotRegistered,
}

/// How a picture lies on the picture of an earlier frame. A camera that turns and zooms about its centre gives a
/// homography between the undistorted pixels of both pictures, whatever the distances in the scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Registration {
    /// Index of the frame whose picture is the reference.
    pub reference: u64,
    /// Homography from pixels of the reference to pixels of this picture: the first eight numbers of its matrix, row by
    /// row. The ninth is 1. Absent if the picture is not displaced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub homography: Option<[f64; 8]>,
    /// Sd of a pixel that is mapped by the homography, px: root mean square over the picture, for a known lens.
    #[schemars(range(min = 0))]
    pub sd_px: f64,
    /// Lens distortion that fits the two pictures best. Absent if the picture is not displaced, and in files of older
    /// versions, whose homography holds for distorted pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<RegisteredLens>,
}

/// Lens distortion that two pictures of a turning camera show, and how the homography depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RegisteredLens {
    /// Radial distortion by the division model at half the picture's width, without unit. The homography holds for
    /// pixels from which it was removed.
    pub bend: f64,
    /// Sd of `bend`.
    #[schemars(range(min = 0))]
    pub sd: f64,
    /// Derivatives of the eight numbers of the homography with respect to `bend`. With another distortion, the two
    /// pictures fit best at the homography that they lead to.
    pub change: [f64; 8],
}

impl Registration {
    /// Returns the mapping from pixels of the reference to pixels of the picture, through the lens that fits these two
    /// pictures best.
    #[must_use]
    pub fn picture_from_reference(&self, size: ImageSize) -> PictureMotion {
        let lens = self.lens.map_or(Lens::STRAIGHT, |lens| Lens::with_distortion(lens.bend, size));
        let homography = self.homography.and_then(Homography::from_numbers);
        PictureMotion::new(homography.unwrap_or(Homography::IDENTITY), lens, size)
    }

    /// Returns the homography from undistorted pixels of the reference to undistorted pixels of the picture, for a lens
    /// with this distortion at half the picture's width.
    #[must_use]
    pub fn homography_for(&self, bend: f64) -> Homography {
        let Some(mut numbers) = self.homography else { return Homography::IDENTITY };
        if let Some(lens) = self.lens {
            numbers.iter_mut().zip(lens.change).for_each(|(n, change)| *n += change * (bend - lens.bend));
        }
        Homography::from_numbers(numbers).unwrap_or(Homography::IDENTITY)
    }
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

    /// Returns the registration of the picture on a reference; `None` if it was not registered on this reference.
    #[must_use]
    pub fn registration_on(&self, reference: u64) -> Option<&Registration> {
        self.motion.iter().find(|registration| registration.reference == reference)
    }
}
