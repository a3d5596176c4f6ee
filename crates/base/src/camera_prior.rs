//! The prior on a camera, and a test whether evidence determines a parameter better than the prior.

use nalgebra::{Matrix4, Vector4};

use crate::{CameraParams, ImageSize};

/// The prior on a surveillance camera: independent Gaussians, where an infinite sd means no prior.
///
/// Default: the focal length is log-normal around 1.2 × the longer image side, sd 0.6. Tilt is 25° ± 20° and roll is
/// 0° ± 6°. The height is log-normal around 7 m, sd 0.8.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPrior {
    /// Median focal length in units of the longer image side.
    pub focal_ratio: f64,
    /// sd of the logarithm of the focal length.
    pub log_focal_sd: f64,
    /// Mean tilt, rad.
    pub tilt: f64,
    /// sd of tilt, rad.
    pub tilt_sd: f64,
    /// sd of roll, rad; its mean is 0.
    pub roll_sd: f64,
    /// Median height, m.
    pub height_m: f64,
    /// sd of the logarithm of the height.
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

    /// Returns the mean of (log f, tilt, roll, log h) for an image of this size.
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

    /// Returns the sd of (log f, tilt, roll, log h).
    #[must_use]
    pub fn sd(&self) -> Vector4<f64> {
        Vector4::new(self.log_focal_sd, self.tilt_sd, self.roll_sd, self.log_height_sd)
    }

    /// Returns the information (1/sd²) on (log f, tilt, roll, log h).
    #[must_use]
    pub fn information(&self) -> Vector4<f64> {
        self.sd().map(|sd| 1.0 / (sd * sd))
    }
}

/// Whether evidence on (log f, tilt, roll, log h) determines parameter `number` better than its prior.
///
/// `evidence` is an information matrix and `prior` holds 1/sd² of each parameter. The other parameters keep their
/// priors. A focal length that is not determined rests on the prior.
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
        // Evidence on the sum of two parameters determines one as well as the other's prior does.
        let direction = Vector4::new(1.0, 1.0, 0.0, 0.0) * 1e6;
        let sum = direction * direction.transpose();
        assert!(is_determined(0, &sum, &prior) && !is_determined(1, &sum, &prior));
    }
}
