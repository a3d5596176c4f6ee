//! The evidence of one window of a clip, as its joint solve gives it.

use roadplane_base::{CameraParams, JointInformation};

use super::options::FuseOptions;
use crate::LinkId;

/// Identity of a car among all windows that are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CarIdentity {
    /// A car of the clip.
    Clip(LinkId),
    /// A car of the camera database.
    Stored(LinkId),
}

/// A car that was used in a window's estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CarUse {
    /// Identity of the car.
    pub car: CarIdentity,
    /// Whether the car was stationary.
    pub parked: bool,
}

/// Result of the joint solve of a window.
#[derive(Clone, Debug)]
pub struct WindowEstimate {
    /// First and last presentation time of the window, s.
    pub span_s: [f64; 2],
    /// Number of frames in the window.
    pub frames: usize,
    /// Focal length, tilt, roll and height from the keypoints alone.
    pub params: CameraParams,
    /// Evidence of the keypoints on the camera and on the errors that the site's cars share, without a camera prior.
    ///
    /// It may be singular. Without the shared errors its mean is `params`.
    pub joint: JointInformation,
    /// Cars that were used.
    pub cars: Vec<CarUse>,
    /// Index of the camera position, from 0, as in [`Window`](crate::Window).
    pub position: usize,
}

impl WindowEstimate {
    /// Returns a window without cars.
    #[must_use]
    pub fn without_cars(options: &FuseOptions, span_s: [f64; 2], position: usize) -> Self {
        Self {
            span_s,
            frames: 0,
            params: options.prior,
            joint: JointInformation::none(),
            cars: Vec::new(),
            position,
        }
    }
}
