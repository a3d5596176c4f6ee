//! Splits the covariance of measurements into a part that varies over time and a bias.

use nalgebra::Matrix3;
use roadplane_measure::POSE_SD_RATIO;

use crate::measurement::Observation;

/// The split of the covariance R, for one track or one stationary interval.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    /// Scatter over frames relative to R, as a ratio of variances.
    pub ratio: f64,
    /// Correlation of the scatter between successive detections, 0–1.
    pub correlation: f64,
}

/// Share of the variance that is common to observations from about one position, 0–1. The design effect: correlated
/// observations count as fewer (Kish 1965, "Survey Sampling").
pub(crate) const COMMON_SHARE: f64 = 0.5;
/// Growth of a bias's variance with the square of the keypoints' misfit, beyond the usual one.
///
/// Keypoints on another car move the pose by more than the distances to their projections show. Maximum likelihood (t
/// distribution) over the poses of 15 rendered clips with the true camera, each car with the same weight: 4.5.
const MISFIT_GROWTH: f64 = 4.5;
/// Time for which a driving car is seen from about the same direction, s. In this time, the bias of its keypoints
/// and the curvature of its path stay the same.
pub(crate) const VIEW_S: f64 = 2.0;
/// Number of sds from which on a value is significant. At such a distance, an outlier of the clock has half a weight.
pub(crate) const SIGNIFICANT: f64 = 3.0;
/// Least number of detections for a measurement of scatter. Motion is measured over as many, if the track has them. It
/// is also the number of inference frames within which a new track must be confirmed.
pub(crate) const MIN_DETECTIONS: usize = 5;

impl Noise {
    /// Measures the split from squared, whitened residuals. Their mean is 3 · `free` if R is all white. `lagged` is
    /// the sum of the products of successive residuals. `free` is the share of the degrees of freedom that fitting left.
    pub(crate) fn measured(squares: &mut [f64], lagged: f64, free: f64) -> Self {
        let n = squares.len();
        if n < MIN_DETECTIONS {
            return Self { ratio: 1.0, correlation: 0.0 };
        }
        let own: f64 = squares.iter().sum();
        squares.sort_by(f64::total_cmp);
        // The median of χ² with 3 degrees of freedom is 2.366; the mean would follow outliers.
        let ratio = (squares[n / 2] / (2.366 * free)).clamp(0.01, 50.0);
        let correlation = if own > 0.0 { (lagged / own).clamp(0.0, 0.95) } else { 0.0 };
        Self { ratio, correlation }
    }

    /// Returns the factor on R of one detection, for an estimator that assumes independent detections.
    pub(crate) fn white(&self) -> f64 {
        self.ratio * (1.0 + self.correlation) / (1.0 - self.correlation)
    }

    /// Returns the factor on R of the error that a track's detections share, as these detections show it. It is the part
    /// of the variance that does not scatter, and at least R. It grows with the misfit of keypoints. All boxes of a vehicle
    /// share their error.
    pub(crate) fn bias(&self, observations: &[Observation]) -> f64 {
        let factor = |seen: &Observation| {
            if seen.from_box {
                return 1.0;
            }
            let beyond = (seen.misfit().unwrap_or(1.0).powi(2) - 1.0).max(0.0);
            (POSE_SD_RATIO.powi(2) - self.ratio).max(1.0) * (1.0 + MISFIT_GROWTH * beyond)
        };
        observations.iter().map(factor).sum::<f64>() / observations.len() as f64
    }
}

/// Returns the covariance of (x, y, heading) if other data give the heading. The position has its covariance given the
/// heading; the rest is zero.
pub(crate) fn given_heading(covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let by_heading = covariance.column(2);
    let mut rest =
        covariance - by_heading * by_heading.transpose() / covariance[(2, 2)].max(f64::MIN_POSITIVE);
    rest.fill_row(2, 0.0);
    rest.fill_column(2, 0.0);
    rest
}
