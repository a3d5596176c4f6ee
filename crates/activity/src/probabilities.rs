//! Probabilities of the labels at regular time steps: the output of the net.

use crate::label::LABELS;

/// Probabilities of the labels at the time steps of a motion. Steps may be skipped while the vehicle is stationary.
#[derive(Clone, Debug, PartialEq)]
pub struct Probabilities {
    /// Steps in rising order, as multiples of [`crate::STEP_S`].
    pub steps: Vec<i64>,
    /// Probability of each label at each step, indexed by [`crate::Label::index`].
    pub p: Vec<[f64; LABELS]>,
    /// Time from each step to the nearest observed sample, s, at most 2.
    pub gap_s: Vec<f64>,
    /// Speed at each step, m/s.
    pub speed_mps: Vec<f64>,
}
