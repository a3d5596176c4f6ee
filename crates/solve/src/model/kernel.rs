//! The outlier model of keypoints, and the robust loss that follows from it.

use crate::linear::lanes::Lanes;

/// The outlier model of keypoints: a keypoint is right with a Gaussian error, or wrong with a uniform error.
///
/// The robust loss ρ is twice the negative log-likelihood of this mixture of two distributions, up to a constant. Its
/// derivative ρ' is the probability that the keypoint is right:
///
/// ```text
/// ρ(s) = −2 ln((e^(−s/2) + e^(−t²/2)) / (1 + e^(−t²/2)))        s: squared whitened residual
/// ρ'(s) = 1 / (1 + e^((s − t²)/2))                              t: threshold, in standard deviations
/// ```
///
/// At a residual of t standard deviations, right and wrong are equally likely. Right keypoints get almost full weight,
/// unlike with Cauchy's or Geman–McClure's loss. So without outliers the loss costs no accuracy. Unlike a truncated
/// square, it is smooth. Far outliers have no influence. Source: Hasler et al. 2003; Barfoot, State Estimation, §5.3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierModel {
    /// Square of the threshold t, which is in standard deviations. An infinite value switches the outlier model off.
    pub threshold_squared: f64,
}

impl Default for OutlierModel {
    fn default() -> Self {
        Self { threshold_squared: 3.75 * 3.75 }
    }
}

impl OutlierModel {
    /// Returns the model without outliers, whose loss is the plain square.
    #[must_use]
    pub fn none() -> Self {
        Self { threshold_squared: f64::INFINITY }
    }

    /// Returns the loss of a far outlier, t², up to a negligible constant; infinite if the outlier model is off.
    #[must_use]
    pub fn cost_of_wrong(&self) -> f64 {
        self.threshold_squared
    }

    /// Returns the robust loss ρ(s) for a squared whitened residual s.
    #[must_use]
    pub fn cost(&self, s: f64) -> f64 {
        PreparedKernel::new(self).evaluate_one(s).0
    }

    /// Returns the weight ρ'(s) for a squared whitened residual s: the probability that the keypoint is right, 0–1.
    #[must_use]
    pub fn weight(&self, s: f64) -> f64 {
        PreparedKernel::new(self).evaluate_one(s).1
    }
}

/// An [`OutlierModel`] with its constant computed in advance, for the inner loop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedKernel {
    threshold_squared: f64,
    /// Constant that makes the loss zero at s = 0: 2 ln(1 + e^(−t²/2)).
    at_zero: f64,
}

impl PreparedKernel {
    pub fn new(model: &OutlierModel) -> Self {
        let threshold_squared = model.threshold_squared;
        Self { threshold_squared, at_zero: 2.0 * (-threshold_squared / 2.0).exp().ln_1p() }
    }

    /// Returns loss and weight (ρ(s), ρ'(s)) of one keypoint.
    pub fn evaluate_one(&self, s: f64) -> (f64, f64) {
        let (cost, weight) = self.evaluate(Lanes::splat(s));
        (cost.0[0], weight.0[0])
    }

    /// Returns losses and weights (ρ(s), ρ'(s)) of four keypoints.
    #[inline(always)]
    pub fn evaluate(&self, s: Lanes) -> (Lanes, Lanes) {
        let threshold = Lanes::splat(self.threshold_squared);
        let one = Lanes::splat(1.0);
        let gap = (s - threshold) * Lanes::splat(0.5);
        // The ratio of the mixture's smaller summand to its larger summand cannot overflow.
        let ratio = gap.abs().exp_of_minus();
        let cost = s.min(threshold) - Lanes::splat(2.0) * ratio.ln_1p_to_one() + Lanes::splat(self.at_zero);
        let weight = gap.select_below(0.0, one, ratio) / (one + ratio);
        (cost, weight)
    }
}
