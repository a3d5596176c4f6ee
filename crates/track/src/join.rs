//! The probability that the vehicle before a gap and the vehicle after it are the same.
//!
//! Linking compares each join with three alternatives. Another tracklet continues the earlier one, the later one continues
//! another tracklet, or neither has a join. With the log likelihood ratios g of `continuation.rs`, the odds
//! of the join from tracklet i to tracklet j are
//!
//! ```text
//! o = exp(g_ij) / (1 + Σ_{k ≠ j} exp(g_ik) + Σ_{k ≠ i} exp(g_kj))
//! ```
//!
//! The likelihoods are simple models, so log o is too certain. A logistic model of log o and of the gap's length gives the
//! probability. `scripts/train/tracks` fits it to rendered clips with truth; `models/tracks.json` has its weights.

use nalgebra::SVector;
use roadplane_base::FrameStamp;

use crate::numbers::{JOIN_FEATURES, NUMBERS, sigmoid};

/// A join of a track over a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Join {
    /// Last detection before the gap.
    pub from: FrameStamp,
    /// First detection after the gap.
    pub to: FrameStamp,
    /// Logarithm of the odds against all alternatives that linking had.
    pub log_odds: f64,
}

impl Join {
    /// Returns the features of the model.
    #[must_use]
    pub fn features(&self) -> [f64; JOIN_FEATURES] {
        features(self.log_odds, self.to.time_s() - self.from.time_s())
    }

    /// Returns the probability that both sides of the gap show the same vehicle, 0–1.
    #[must_use]
    pub fn same_vehicle_p(&self) -> f64 {
        probability(self.features())
    }
}

/// Returns the features of a join over a gap (s) with these log odds.
pub(crate) fn features(log_odds: f64, gap_s: f64) -> [f64; JOIN_FEATURES] {
    [1.0, log_odds, gap_s.max(0.0).ln_1p()]
}

/// Returns the probability that a join with these features is right, 0–1.
pub(crate) fn probability(features: [f64; JOIN_FEATURES]) -> f64 {
    sigmoid(SVector::from(features).dot(&NUMBERS.same_vehicle))
}
