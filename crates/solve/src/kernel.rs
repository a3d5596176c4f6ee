//! Robust loss on keypoints.

/// A keypoint is right with Gaussian error, or wrong and anywhere: the negative log-likelihood of that mixture,
///
/// ```text
/// ρ(s) = −2 ln((e^(−s/2) + e^(−t²/2)) / (1 + e^(−t²/2)))        s = squared whitened residual
/// ρ'(s) = 1 / (1 + e^((s − t²)/2))                              = probability that the keypoint is right
/// ```
///
/// Where right and wrong are equally likely lies the threshold t (in sd). Unlike Cauchy's or Geman–McClure's loss it
/// leaves Gaussian keypoints (nearly) full weight, so nothing is lost when there are no outliers, and unlike a truncated
/// square it is smooth. Far outliers have no influence. Source: Hasler et al. 2003; Barfoot, State Estimation, §5.3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierModel {
    /// t², the square of the threshold in sd; infinite switches robustness off.
    pub threshold_squared: f64,
}

impl Default for OutlierModel {
    fn default() -> Self {
        Self { threshold_squared: 14.0 }
    }
}

impl OutlierModel {
    /// The plain square.
    #[must_use]
    pub fn none() -> Self {
        Self { threshold_squared: f64::INFINITY }
    }

    /// ρ(s).
    #[must_use]
    pub fn cost(&self, s: f64) -> f64 {
        let t2 = self.threshold_squared;
        if !t2.is_finite() {
            return s;
        }
        // ln(e^(−s/2) + e^(−t²/2)) with the larger exponent taken out, so that nothing underflows.
        let gap = -(s - t2).abs() / 2.0;
        s.min(t2) - 2.0 * gap.exp().ln_1p() + 2.0 * (-t2 / 2.0).exp().ln_1p()
    }

    /// ρ'(s), in 0…1.
    #[must_use]
    pub fn weight(&self, s: f64) -> f64 {
        if self.threshold_squared.is_finite() {
            1.0 / (1.0 + ((s - self.threshold_squared) / 2.0).exp())
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weight_is_the_derivative_of_cost() {
        for model in [OutlierModel::default(), OutlierModel { threshold_squared: 6.0 }, OutlierModel::none()]
        {
            assert!(model.cost(0.0).abs() < 1e-15);
            for step in 0..400 {
                let s = 0.1 * f64::from(step) + 1e-3;
                let numeric = (model.cost(s + 1e-5) - model.cost(s - 1e-5)) / 2e-5;
                assert!((numeric - model.weight(s)).abs() < 1e-6, "s = {s}");
            }
            assert!(model.cost(1e300).is_finite() && model.weight(1e300).is_finite());
        }
    }
}
