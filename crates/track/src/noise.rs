//! How much of a measurement's covariance shows over time, and how much is bias.

use nalgebra::Matrix3;

/// The split of R for one track (or one stand).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    /// Scatter over frames against R.
    pub ratio: f64,
    /// Correlation of the scatter from one sighting to the next.
    pub correlation: f64,
    bias_share: f64,
}

/// Sightings below which scatter says nothing.
const MIN_SIGHTINGS: usize = 8;

impl Noise {
    /// From squared, whitened residuals (mean 3 · `free` where R is all white) and their products from one sighting to the
    /// next; `free` is the share of the degrees of freedom that fitting left.
    pub(crate) fn measured(squares: &mut [f64], own: f64, lagged: f64, free: f64, bias_share: f64) -> Self {
        let n = squares.len();
        if n < MIN_SIGHTINGS {
            return Self { ratio: 1.0, correlation: 0.0, bias_share };
        }
        squares.sort_by(f64::total_cmp);
        // The median of χ² with 3 degrees of freedom is 2.366; the mean would follow outliers.
        let ratio = (squares[n / 2] / (2.366 * free)).clamp(0.01, 50.0);
        let correlation = if own > 0.0 { (lagged / own).clamp(0.0, 0.95) } else { 0.0 };
        Self { ratio, correlation, bias_share }
    }

    /// Factor on R for one sighting in an estimator that takes sightings for independent.
    pub(crate) fn white(&self) -> f64 {
        self.ratio * (1.0 + self.correlation) / (1.0 - self.correlation)
    }

    /// Factor on R for the error that all sightings share.
    pub(crate) fn bias(&self) -> f64 {
        (1.0 - self.ratio).max(self.bias_share * self.bias_share)
    }
}

/// Covariance of (x, y, heading) where the heading is known otherwise: that of the place given the heading, and none of the heading.
pub(crate) fn given_heading(covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let by_heading = covariance.column(2);
    let mut rest =
        covariance - by_heading * by_heading.transpose() / covariance[(2, 2)].max(f64::MIN_POSITIVE);
    rest.fill_row(2, 0.0);
    rest.fill_column(2, 0.0);
    rest
}
