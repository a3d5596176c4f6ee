//! The fitted numbers of `models/tracks.json`.

use std::sync::LazyLock;

use nalgebra::SVector;
use serde::Deserialize;

/// Number of features of existence (`existence.rs`).
pub const FEATURES: usize = 7;
/// Number of features of a join (`join.rs`).
pub const JOIN_FEATURES: usize = 3;

/// Weights of the logistic models.
pub(crate) struct Numbers {
    /// Weights of the features of existence.
    pub existence: SVector<f64, FEATURES>,
    /// Weights of the features of a join.
    pub same_vehicle: SVector<f64, JOIN_FEATURES>,
}

/// The file's content.
#[derive(Default, Deserialize)]
struct File {
    /// One weight for each feature of existence.
    existence: Vec<f64>,
    /// One weight for each feature of a join.
    same_vehicle: Vec<f64>,
}

/// The numbers of the file that is a part of the program. A test checks it.
pub(crate) static NUMBERS: LazyLock<Numbers> = LazyLock::new(|| {
    let file: File = serde_json::from_str(include_str!("../../../models/tracks.json")).unwrap_or_default();
    Numbers { existence: vector(&file.existence), same_vehicle: vector(&file.same_vehicle) }
});

/// Returns the weights as a vector of this size; zeros if the file has another number of weights.
fn vector<const SIZE: usize>(weights: &[f64]) -> SVector<f64, SIZE> {
    if weights.len() == SIZE { SVector::from_column_slice(weights) } else { SVector::zeros() }
}

/// Returns the probability with these log odds, 0–1.
pub(crate) fn sigmoid(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_has_one_weight_for_each_feature() {
        let weights = NUMBERS.existence.iter().chain(&NUMBERS.same_vehicle);
        assert!(weights.clone().all(|weight| weight.is_finite() && *weight != 0.0));
    }
}
