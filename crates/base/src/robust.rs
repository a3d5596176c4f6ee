//! Robust statistics: medians and Student's t distribution.

use std::cmp::Ordering;

/// Returns the median of finite numbers, or `None` for an empty list. The function sorts `values`.
#[must_use]
pub fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

/// Returns the middle value in the given order, or the upper one of two middle values.
///
/// The result is always one of the values. In contrast, [`median`] may return a number between two values. Returns
/// `None` for an empty list. The function sorts `values`.
#[must_use]
pub fn upper_median<T: Copy>(values: &mut [T], order: impl FnMut(&T, &T) -> Ordering) -> Option<T> {
    values.sort_by(order);
    values.get(values.len() / 2).copied()
}

/// Returns the weighted median of (value, weight) pairs: the smallest value at which the summed weight reaches half of
/// the total weight.
///
/// Returns `None` if no weight is positive. The function sorts `values`.
#[must_use]
pub fn weighted_median(values: &mut [(f64, f64)]) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = values.iter().map(|v| v.1).sum::<f64>() / 2.0;
    let mut below = 0.0;
    values
        .iter()
        .find(|(_, weight)| {
            below += weight;
            *weight > 0.0 && below >= half
        })
        .map(|v| v.0)
}

/// Student's t distribution of errors, with ν = 4 degrees of freedom.
///
/// Near zero the distribution is similar to a Gaussian. Its tails are heavier, so outliers have less influence on an
/// estimate.
///
/// An estimate minimises [`StudentT::cost`] by iteratively reweighted least squares (Lange, Little and Taylor 1989, J.
/// Am. Stat. Assoc. 84).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StudentT {
    /// Number of dimensions of an error vector.
    pub dimensions: f64,
}

impl StudentT {
    /// Degrees of freedom ν. A smaller ν gives outliers less weight.
    const FREEDOM: f64 = 4.0;

    /// Returns the least-squares weight of an error, relative to a Gaussian error.
    ///
    /// `squared` is the squared Mahalanobis distance of the error.
    #[must_use]
    pub fn weight(&self, squared: f64) -> f64 {
        (Self::FREEDOM + self.dimensions) / (Self::FREEDOM + squared)
    }

    /// Returns the negative log density of an error, up to a constant.
    ///
    /// `squared` is the squared Mahalanobis distance of the error.
    #[must_use]
    pub fn cost(&self, squared: f64) -> f64 {
        0.5 * (Self::FREEDOM + self.dimensions) * (squared / Self::FREEDOM).ln_1p()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_is_the_derivative_of_the_cost() {
        let t = StudentT { dimensions: 3.0 };
        for squared in [0.0, 0.7, 3.0, 40.0] {
            let slope = (t.cost(squared + 1e-6) - t.cost(squared)) / 1e-6;
            assert!((2.0 * slope - t.weight(squared)).abs() < 1e-5);
        }
    }

    #[test]
    fn medians_resist_one_bad_value() {
        assert_eq!(median(&mut [3.0, 1.0, 1e9]), Some(3.0));
        assert_eq!(median(&mut [1.0, 2.0]), Some(1.5));
        assert_eq!(median(&mut []), None);
        assert_eq!(upper_median(&mut [2_u8, 9, 1, 4], u8::cmp), Some(4));
        assert_eq!(upper_median(&mut [], f64::total_cmp), None);
        assert_eq!(weighted_median(&mut [(5.0, 1.0), (1.0, 1.0), (9.0, 10.0)]), Some(9.0));
        assert_eq!(weighted_median(&mut [(5.0, 0.0)]), None);
    }
}
