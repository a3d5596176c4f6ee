//! What became of an input's frames.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Stretches of damage that are listed one by one; later ones are only counted.
const MAX_STRETCHES: usize = 100;
/// Warnings that are kept.
const MAX_WARNINGS: usize = 20;

/// A run of consecutive frames that were lost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Stretch {
    /// Index of the first frame lost.
    pub first_frame: u64,
    /// Frames lost.
    pub frames: u64,
    /// Presentation time of the first, s.
    pub from_s: f64,
}

/// What became of an input's frames; complete once the input is read to its end.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DecodeReport {
    /// Frames that the input holds, or held before it was cut, as far as it was read.
    pub expected: u64,
    /// Frames decoded, with those that options leave out.
    pub decoded: u64,
    /// Frames handed on.
    pub delivered: u64,
    /// `expected - decoded`: frames that are lost.
    pub missing: u64,
    /// Where frames are lost, in the order found; not more than a hundred are listed.
    pub damaged_stretches: Vec<Stretch>,
    /// Number of such places.
    pub damaged_stretch_count: u64,
    /// Packets with slices that cannot be; their pictures are decoded as far as possible and may be spoilt.
    pub broken_packets: u64,
    /// The file ends before its own structure says.
    pub cut_short: bool,
    /// Frames whose time had to be made up: the stream gave none, or one not after its predecessor's.
    pub times_made_up: u64,
    /// What else is worth knowing.
    pub warnings: Vec<String>,
}

impl DecodeReport {
    /// Whether some of the input was lost or spoilt: the exit code must say so.
    #[must_use]
    pub fn is_damaged(&self) -> bool {
        self.missing > 0 || self.broken_packets > 0 || self.cut_short
    }

    /// Counts a run of lost frames.
    pub(crate) fn lost(&mut self, index: u64, frames: u64, time_s: f64) {
        self.missing += frames;
        self.expected += frames;
        match self.damaged_stretches.last_mut() {
            Some(last) if last.first_frame + last.frames == index => last.frames += frames,
            _ => {
                self.damaged_stretch_count += 1;
                if self.damaged_stretches.len() < MAX_STRETCHES {
                    self.damaged_stretches.push(Stretch { first_frame: index, frames, from_s: time_s });
                }
            }
        }
    }

    /// Takes gaps back that turn out to be no damage; `really` frames are lost all the same, at unknown places.
    pub(crate) fn forget_gaps(&mut self, really: u64) {
        self.missing = really;
        self.expected = self.decoded + really;
        if really == 0 {
            self.damaged_stretches.clear();
            self.damaged_stretch_count = 0;
        }
    }

    /// What was so far is another's to count.
    pub(crate) fn begin_here(&mut self) {
        let warnings = std::mem::take(&mut self.warnings);
        *self = Self { warnings, ..Self::default() };
    }

    pub(crate) fn decoded_one(&mut self) {
        self.decoded += 1;
        self.expected += 1;
    }

    pub(crate) fn warn(&mut self, what: impl Into<String>) {
        let what = what.into();
        tracing::warn!("{what}");
        if self.warnings.len() < MAX_WARNINGS {
            self.warnings.push(what);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_losses_are_one_stretch() {
        let mut report = DecodeReport::default();
        report.decoded_one();
        for index in [1, 2, 5] {
            report.lost(index, 1, index as f64);
        }
        assert_eq!((report.expected, report.decoded, report.missing), (4, 1, 3));
        let runs: Vec<_> = report.damaged_stretches.iter().map(|s| (s.first_frame, s.frames)).collect();
        assert_eq!(runs, [(1, 2), (5, 1)]);
        assert!(report.is_damaged());
    }
}
