//! The activity net: computes the probability of each label at the steps of a motion.

use std::path::Path;

use ndarray::Array3;
use roadplane_infer::{Dim, InferError, NamedTensor, Session, SessionOptions};
use thiserror::Error;

use crate::decode::labelled;
use crate::events::Labelled;
use crate::features::{FEATURES, GAP, features, speed_mps};
use crate::label::{LABELS, Label};
use crate::motion::{Motion, MotionError, grid};
use crate::probabilities::Probabilities;

/// Number of steps of a rest that the net reads before and after a motion (10 s each). The middle steps of a longer
/// rest are skipped.
const CONTEXT: i64 = 50;
/// Largest distance between the positions of a vehicle at rest, m.
const STILL_M: f64 = 0.01;

/// The reason why labels cannot be computed.
#[derive(Debug, Error)]
pub enum ActivityError {
    /// The net cannot be loaded or run.
    #[error(transparent)]
    Net(#[from] InferError),
    /// The inputs or outputs of the net do not match the features and labels of this crate.
    #[error("activity net {model}: {what}")]
    UnsuitableNet {
        /// Name of the net.
        model: String,
        /// The input or output that is missing or wrong.
        what: String,
    },
    /// The motion is not valid.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

/// The activity net: a bidirectional LSTM whose inputs and outputs are described in a card (a JSON file).
#[derive(Debug)]
pub struct ActivityNet {
    session: Session,
}

impl ActivityNet {
    /// Loads the net that the file `card` describes.
    ///
    /// # Errors
    /// [`ActivityError`] if the net cannot be loaded, or if its features or labels are not those of this crate.
    pub fn open(card: &Path, session: &SessionOptions) -> Result<Self, ActivityError> {
        let session = Session::open(card, session)?;
        let card = session.card();
        let unsuitable =
            |what: &str| ActivityError::UnsuitableNet { model: card.name.clone(), what: what.to_owned() };
        let width_of = |shape: &[Dim]| match shape {
            [_, _, Dim::Fixed(width)] => Some(*width),
            _ => None,
        };
        if card.input("motion").and_then(|spec| width_of(&spec.shape)) != Some(FEATURES) {
            return Err(unsuitable(&format!("motion is not [batch, steps, {FEATURES}]")));
        }
        if card.output("labels").and_then(|spec| width_of(&spec.shape)) != Some(LABELS) {
            return Err(unsuitable(&format!("labels is not [batch, steps, {LABELS}]")));
        }
        let names = card.preprocess.get("labels").and_then(serde_json::Value::as_array);
        let labels = names.map(|names| names.iter().map(|name| name.as_str()).collect::<Vec<_>>());
        if labels != Some(Label::ALL.map(|label| Some(label.name())).to_vec()) {
            return Err(unsuitable("preprocess.labels are not the labels in their order"));
        }
        Ok(Self { session })
    }

    /// Returns the session that runs the net.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Returns the probabilities of the labels at the steps of a motion.
    ///
    /// # Errors
    /// [`ActivityError::Motion`] if the motion is not valid, [`ActivityError::Net`] if the runtime fails.
    pub fn probabilities(&mut self, motion: &Motion) -> Result<Probabilities, ActivityError> {
        motion.check()?;
        let steps = steps_of(motion);
        let rows = features(motion, &steps);
        let values = Array3::from_shape_fn((1, rows.len(), FEATURES), |(_, step, i)| rows[step][i]);
        let outputs =
            self.session.run(&[NamedTensor { name: "motion", values: values.view().into_dyn() }])?;
        let missing = || InferError::Failed {
            model: self.session.card().name.clone(),
            what: "the output labels is missing or of another shape".to_owned(),
        };
        let labels = outputs.get("labels").ok_or_else(missing)?;
        let labels = labels.into_dimensionality::<ndarray::Ix3>().map_err(|_other_shape| missing())?;
        if labels.dim() != (1, steps.len(), LABELS) {
            return Err(missing().into());
        }
        let row = |step| std::array::from_fn(|label| f64::from(labels[[0, step, label]]));
        let p = (0..steps.len()).map(row).collect();
        let gap_s = rows.iter().map(|row| f64::from(row[GAP])).collect();
        let speed_mps = rows.iter().map(speed_mps).collect();
        Ok(Probabilities { steps, p, gap_s, speed_mps })
    }

    /// Returns the label of each sample of a motion, and the intervals of each label.
    ///
    /// # Errors
    /// The errors of [`Self::probabilities`].
    pub fn label(&mut self, motion: &Motion) -> Result<Labelled, ActivityError> {
        Ok(labelled(&self.probabilities(motion)?, motion))
    }
}

/// Returns the steps of a motion without the middle of long rests. All positions of a rest are the same within
/// [`STILL_M`].
fn steps_of(motion: &Motion) -> Vec<i64> {
    let (Some(first), Some(last)) = (motion.time_s.first(), motion.time_s.last()) else { return Vec::new() };
    let mut steps: Vec<i64> = grid(*first, *last).collect();
    let mut from = 0;
    while from < motion.time_s.len() {
        let still = |xy: &[f64; 2]| {
            let rest = motion.xy_m[from];
            (xy[0] - rest[0]).hypot(xy[1] - rest[1]) <= STILL_M
        };
        let stay = motion.xy_m[from..].iter().take_while(|xy| still(xy)).count();
        let end = from + stay;
        let within = grid(motion.time_s[from], motion.time_s[end - 1]);
        let (skip_from, skip_to) = (within.start() + CONTEXT, within.end() - CONTEXT);
        if skip_from < skip_to {
            steps.retain(|step| *step <= skip_from || *step >= skip_to);
        }
        from = end;
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_middle_of_a_long_rest_is_skipped() {
        let time_s: Vec<f64> = (0..36_000).map(|i| f64::from(i) * 0.1).collect();
        let drive = |t: f64| if t < 1800.0 { 0.0 } else { 5.0 * (t - 1800.0) };
        let xy_m: Vec<[f64; 2]> = time_s.iter().map(|t| [drive(*t).min(500.0), 0.0]).collect();
        let steps = steps_of(&Motion { time_s: time_s.clone(), xy_m, ..Motion::default() });
        let within = |from: f64, to: f64| {
            steps.iter().filter(|step| (from..=to).contains(&(**step as f64 * crate::STEP_S))).count()
        };
        assert_eq!(within(11.0, 1789.0), 0);
        assert_eq!(within(1790.0, 1910.0), 601);
        assert_eq!(within(1911.0, 3589.0), 0);
        assert!(steps.is_sorted() && steps.len() < 720);
    }
}
