//! Options for joining windows: the prior of the camera, and the factors.

use std::collections::BTreeMap;

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{
    CameraEstimate, CameraParams, CameraPrior, CameraStatus, ImageSize, Lens, SHARED_ERRORS, SharedSd,
};

use crate::factors::Factor;

/// Least sd of a number of the camera or of the cars' size, log or rad. It stands for exact numbers, and it keeps matrices
/// invertible.
pub const LEAST_SD: f64 = 1e-6;

/// Options for joining windows.
#[derive(Clone, Debug)]
pub struct FuseOptions {
    /// Size of the pictures; copied to the result.
    pub image_size_px: ImageSize,
    /// Whether the user gave the focal length; the prior then contains it.
    pub focal_given: bool,
    /// Mean of the camera's prior, which is counted once.
    pub prior: CameraParams,
    /// Sds of the prior: log focal length, tilt (rad), roll (rad) and log height.
    pub prior_sd: Vector4<f64>,
    /// Sds of the errors that all cars of the site share, and so all windows. The scatter of windows does not show
    /// them.
    pub shared_sd: SharedSd,
    /// Lens distortion with which the windows were solved.
    pub lens: Lens,
    /// Sd of the distortion ([`Lens::distortion`]); `None` where neither the picture nor the user determines it.
    pub distortion_sd: Option<f64>,
    /// Other factors on the camera, by camera position ([`WindowEstimate::position`](crate::WindowEstimate::position)).
    /// Each factor is counted once.
    pub factors: BTreeMap<usize, Vec<Factor>>,
    /// Whether the positions are the two planes of a folded ground below one camera ([`Fold`](crate::Fold)).
    pub is_folded: bool,
    /// Sd of the log size of the site's cars relative to the atlas.
    ///
    /// All windows share this error of scale. Factors in metres determine it.
    pub size_of_cars_sd: f64,
}

impl FuseOptions {
    /// Returns the options without factors, for the camera from cars alone, in units of the atlas's cars.
    #[must_use]
    pub fn for_cars(&self) -> Self {
        Self { factors: BTreeMap::new(), size_of_cars_sd: 0.0, ..self.clone() }
    }

    /// Returns an estimate with the numbers and sds of the prior, and the status "unobservable".
    #[must_use]
    pub fn unobservable(&self, span_s: [f64; 2]) -> CameraEstimate {
        CameraEstimate {
            span_s,
            image_size_px: self.image_size_px,
            principal_point_px: self.image_size_px.centre_px(),
            lens: self.lens,
            distortion_sd: self.distortion_sd,
            params: self.prior,
            covariance: Matrix4::from_diagonal(&self.prior_sd.map(|sd| sd * sd)),
            status: CameraStatus::Unobservable,
            cars_used: 0,
            frames_used: 0,
            second_plane: None,
        }
    }

    /// Returns the defaults for pictures of this size: the default [`CameraPrior`].
    #[must_use]
    pub fn for_image(image_size_px: ImageSize) -> Self {
        Self::new(image_size_px, &CameraPrior::default(), None)
    }

    /// Returns the options with this prior for pictures of this size. A given focal length (px) replaces the prior's one.
    #[must_use]
    pub fn new(image_size_px: ImageSize, prior: &CameraPrior, given_focal_px: Option<f64>) -> Self {
        let (mut mean, mut prior_sd) = (prior.mean(image_size_px), prior.sd());
        if let Some(focal_px) = given_focal_px {
            (mean.log_focal, prior_sd[0]) = (focal_px.ln(), LEAST_SD);
        }
        Self {
            image_size_px,
            focal_given: given_focal_px.is_some(),
            prior: mean,
            prior_sd,
            shared_sd: [0.0; SHARED_ERRORS],
            lens: Lens::STRAIGHT,
            distortion_sd: None,
            factors: BTreeMap::new(),
            is_folded: false,
            size_of_cars_sd: 0.0,
        }
    }
}
