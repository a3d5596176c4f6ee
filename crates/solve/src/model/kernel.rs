//! The robust loss of keypoints.

use crate::linear::lanes::Lanes;

/// The outlier model of keypoints: a keypoint is right with a Gaussian error, or wrong and uniform.
///
/// Its loss is the negative log-likelihood of that mixture,
///
/// ```text
/// ρ(s) = −2 ln((e^(−s/2) + e^(−t²/2)) / (1 + e^(−t²/2)))        s = squared whitened residual
/// ρ'(s) = 1 / (1 + e^((s − t²)/2))                              = probability that the keypoint is right
/// ```
///
/// At the threshold t (in sd), right and wrong are equally likely. Keypoints with Gaussian errors keep almost full
/// weight, unlike with Cauchy's or Geman–McClure's loss. So the loss costs no accuracy without outliers. It is smooth,
/// unlike a truncated square. Far outliers have no influence. Source: Hasler et al. 2003; Barfoot, State Estimation,
/// §5.3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierModel {
    /// t², the square of the threshold in sd. An infinite value switches robustness off.
    pub threshold_squared: f64,
}

impl Default for OutlierModel {
    fn default() -> Self {
        Self { threshold_squared: 3.75 * 3.75 }
    }
}

impl OutlierModel {
    /// Returns the plain square, without robustness.
    #[must_use]
    pub fn none() -> Self {
        Self { threshold_squared: f64::INFINITY }
    }

    /// Returns the cost of a wrong keypoint, t²: ρ(∞) up to a vanishing constant; infinite without robustness.
    #[must_use]
    pub fn cost_of_wrong(&self) -> f64 {
        self.threshold_squared
    }

    /// Returns the loss ρ(s) of a squared whitened residual.
    #[must_use]
    pub fn cost(&self, s: f64) -> f64 {
        PreparedKernel::new(self).evaluate_one(s).0
    }

    /// Returns the weight ρ'(s) of a squared whitened residual, 0–1.
    #[must_use]
    pub fn weight(&self, s: f64) -> f64 {
        PreparedKernel::new(self).evaluate_one(s).1
    }
}

/// An [`OutlierModel`] with its constant computed in advance, for the inner loop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedKernel {
    threshold_squared: f64,
    /// Constant of the loss: 2 ln(1 + e^(−t²/2)).
    at_zero: f64,
}

impl PreparedKernel {
    pub fn new(model: &OutlierModel) -> Self {
        let threshold_squared = model.threshold_squared;
        Self { threshold_squared, at_zero: 2.0 * (-threshold_squared / 2.0).exp().ln_1p() }
    }

    /// Returns (ρ(s), ρ'(s)) of one keypoint.
    pub fn evaluate_one(&self, s: f64) -> (f64, f64) {
        let (cost, weight) = self.evaluate(Lanes::splat(s));
        (cost.0[0], weight.0[0])
    }

    /// Returns (ρ(s), ρ'(s)) of four keypoints.
    #[inline(always)]
    pub fn evaluate(&self, s: Lanes) -> (Lanes, Lanes) {
        let threshold = Lanes::splat(self.threshold_squared);
        let one = Lanes::splat(1.0);
        let gap = (s - threshold) * Lanes::splat(0.5);
        // The ratio of the mixture's smaller part to the larger one cannot overflow.
        let ratio = gap.abs().exp_of_minus();
        let cost = s.min(threshold) - Lanes::splat(2.0) * ratio.ln_1p_to_one() + Lanes::splat(self.at_zero);
        let weight = gap.select_below(0.0, one, ratio) / (one + ratio);
        (cost, weight)
    }
}
