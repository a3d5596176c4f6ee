//! The fitted numbers of `models/tracks.json`.

use std::sync::LazyLock;

use nalgebra::SVector;
use serde::Deserialize;

/// Number of features of existence (`existence.rs`).
pub const FEATURES: usize = 7;
/// Number of features of a join (`join.rs`).
pub const JOIN_FEATURES: usize = 3;

/// Weights of the logistic models, and the numbers of colours.
#[derive(Default, Deserialize)]
pub(crate) struct Numbers {
    /// Weights of the features of existence.
    pub existence: SVector<f64, FEATURES>,
    /// Weights of the features of a join.
    pub same_vehicle: SVector<f64, JOIN_FEATURES>,
    /// Differences of colours: the sds of light and of tint for one vehicle, 0–255, then the ratio of the sds of two
    /// vehicles to those of one.
    pub colour: [f64; 3],
}

/// The numbers of the file that is a part of the program. A test checks it.
pub(crate) static NUMBERS: LazyLock<Numbers> =
    LazyLock::new(|| serde_json::from_str(include_str!("../../../models/tracks.json")).unwrap_or_default());

/// Returns the probability with these log odds, 0–1.
pub(crate) fn sigmoid(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_has_all_numbers() {
        let weights = NUMBERS.existence.iter().chain(&NUMBERS.same_vehicle);
        assert!(weights.clone().all(|weight| weight.is_finite() && *weight != 0.0));
        assert!(NUMBERS.same_vehicle[1] > 0.0, "better odds make a join more probable");
        let [light_sd, tint_sd, ratio] = NUMBERS.colour;
        assert!(light_sd > 0.0 && tint_sd > 0.0 && ratio > 1.0);
    }
}
