//! The prior on a camera's parameters, and a test that compares evidence with the prior.

use nalgebra::{Matrix4, Vector4};

use crate::{CameraParams, ImageSize};

/// The prior on a surveillance camera: independent Gaussians. An infinite sd means that the parameter has no prior.
///
/// By default, the focal length has a median of 1.2 × the longer image side, and its logarithm has an sd of 0.6. The
/// height has a median of 7 m, and its logarithm has an sd of 0.8. Tilt is 25° ± 20° and roll is 0° ± 6° (mean ± sd).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPrior {
    /// Median focal length in units of the longer image side.
    pub focal_ratio: f64,
    /// Sd of the logarithm of the focal length.
    pub log_focal_sd: f64,
    /// Mean tilt, rad.
    pub tilt: f64,
    /// Sd of tilt, rad.
    pub tilt_sd: f64,
    /// Sd of roll, rad. The mean of roll is 0.
    pub roll_sd: f64,
    /// Median height, m.
    pub height_m: f64,
    /// Sd of the logarithm of the height.
    pub log_height_sd: f64,
}

impl Default for CameraPrior {
    fn default() -> Self {
        Self {
            focal_ratio: 1.2,
            log_focal_sd: 0.6,
            tilt: 25_f64.to_radians(),
            tilt_sd: 20_f64.to_radians(),
            roll_sd: 6_f64.to_radians(),
            height_m: 7.0,
            log_height_sd: 0.8,
        }
    }
}

impl CameraPrior {
    /// Returns a prior without any information.
    #[must_use]
    pub fn none() -> Self {
        let none = f64::INFINITY;
        Self { log_focal_sd: none, tilt_sd: none, roll_sd: none, log_height_sd: none, ..Self::default() }
    }

    /// Returns the prior mean of the camera parameters for an image of this size.
    #[must_use]
    pub fn mean(&self, size: ImageSize) -> CameraParams {
        let longer = f64::from(size.width.max(size.height).max(1));
        CameraParams {
            log_focal: (self.focal_ratio * longer).ln(),
            tilt: self.tilt,
            roll: 0.0,
            log_height: self.height_m.ln(),
        }
    }

    /// Returns the prior sds of (log focal, tilt, roll, log height).
    #[must_use]
    pub fn sd(&self) -> Vector4<f64> {
        Vector4::new(self.log_focal_sd, self.tilt_sd, self.roll_sd, self.log_height_sd)
    }

    /// Returns the prior information (1/sd²) on (log focal, tilt, roll, log height).
    #[must_use]
    pub fn information(&self) -> Vector4<f64> {
        self.sd().map(|sd| 1.0 / (sd * sd))
    }
}

/// Whether the evidence determines parameter `number` better than the prior of that parameter does.
///
/// The parameters are (log focal, tilt, roll, log height). `evidence` is their information matrix (inverse covariance),
/// and `prior` contains the 1/sd² of each prior. The other parameters keep their priors in this test.
#[must_use]
pub fn is_determined(number: usize, evidence: &Matrix4<f64>, prior: &Vector4<f64>) -> bool {
    let mut others = *prior;
    others[number] = 0.0;
    let with = evidence + Matrix4::from_diagonal(&others);
    let variance = with.try_inverse().map_or(f64::INFINITY, |inverse| inverse[(number, number)]);
    variance > 0.0 && variance < 1.0 / prior[number]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_is_determined_where_evidence_beats_the_prior() {
        let prior = Vector4::new(4.0, 25.0, 100.0, 1.0);
        assert!(!is_determined(0, &Matrix4::zeros(), &prior));
        assert!(is_determined(0, &Matrix4::from_diagonal(&Vector4::new(5.0, 0.0, 0.0, 0.0)), &prior));
        assert!(!is_determined(0, &Matrix4::from_diagonal(&Vector4::new(3.0, 9e9, 9e9, 9e9)), &prior));
        // With evidence on the sum of two parameters, each parameter is determined as well as the prior determines the
        // other.
        let direction = Vector4::new(1.0, 1.0, 0.0, 0.0) * 1e6;
        let sum = direction * direction.transpose();
        assert!(is_determined(0, &sum, &prior) && !is_determined(1, &sum, &prior));
    }
}
