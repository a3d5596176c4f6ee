//! The report on an input's frames.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Largest number of intervals of lost frames that are listed. Further intervals are only counted.
const MAX_INTERVALS: usize = 100;
/// Largest number of warnings that are kept.
const MAX_WARNINGS: usize = 20;

/// An interval of consecutive frames that were lost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DamagedInterval {
    /// Index of the first lost frame, from 0.
    pub first_frame: u64,
    /// Number of lost frames.
    pub frames: u64,
    /// Presentation time of the first lost frame, s.
    pub from_s: f64,
}

/// Counts of an input's frames. They are complete when the input has been read to its end.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DecodeReport {
    /// Number of frames of the input, as far as it was read. This number includes lost frames and frames that were cut
    /// off at the end.
    pub expected: u64,
    /// Number of frames that were decoded, including those that the settings leave out.
    pub decoded: u64,
    /// Number of decoded frames that were passed to the pipeline.
    pub delivered: u64,
    /// Number of lost frames: `expected - decoded`.
    pub missing: u64,
    /// Intervals of lost frames, in the order in which they were found. At most a hundred are listed.
    pub damaged_stretches: Vec<DamagedInterval>,
    /// Number of intervals of lost frames.
    pub damaged_stretch_count: u64,
    /// Number of packets with invalid slices. Their pictures are decoded as far as possible and may be damaged.
    pub broken_packets: u64,
    /// Whether the file ends earlier than its own structure states.
    pub cut_short: bool,
    /// Number of frames with an invented time. For such a frame, the stream stated no time, or a time that was not
    /// after the previous frame's time.
    pub times_made_up: u64,
    /// Number of lost frames whose cause is a warning of its own in `warnings`.
    #[serde(default)]
    pub explained: u64,
    /// Warnings about the input, in plain text. The summary of a run adds one sentence about all lost frames.
    pub warnings: Vec<String>,
}

impl DecodeReport {
    /// Whether some of the input was lost or damaged. The exit code must show such damage.
    #[must_use]
    pub fn is_damaged(&self) -> bool {
        self.missing > 0 || self.broken_packets > 0 || self.cut_short
    }

    /// Returns one sentence about all damage of the input: lost frames, damaged pictures and an early end of the file.
    ///
    /// Returns `None` without damage, and if `warnings` explains every lost frame already.
    #[must_use]
    pub fn damage_in_words(&self) -> Option<String> {
        let &Self { missing, expected, damaged_stretch_count: places, broken_packets: broken, .. } = self;
        let mut parts = Vec::new();
        if missing > self.explained {
            let places = if places == 1 { "1 place".to_owned() } else { format!("{places} places") };
            parts.push(format!("{missing} of {expected} frames are lost, in {places}"));
        }
        if broken > 0 {
            parts.push(format!("{broken} packets have broken slices, so their pictures may be damaged"));
        }
        match (self.cut_short, parts.is_empty()) {
            (false, true) => None,
            (true, true) => Some("the file is cut short".to_owned()),
            (true, false) => Some(format!("the file is cut short: {}", parts.join("; "))),
            (false, false) => Some(format!("the input is damaged: {}", parts.join("; "))),
        }
    }

    /// Counts one lost frame, and warns of the cause of its loss.
    pub(crate) fn left_out(&mut self, index: u64, time_s: f64, why: &str) {
        if self.warnings.len() < MAX_WARNINGS {
            self.explained += 1;
        }
        self.warn(format!("frame {index} is lost: {why}"));
        self.lost(index, 1, time_s);
    }

    /// Counts an interval of lost frames.
    pub(crate) fn lost(&mut self, index: u64, frames: u64, time_s: f64) {
        self.missing += frames;
        self.expected += frames;
        match self.damaged_stretches.last_mut() {
            Some(last) if last.first_frame + last.frames == index => last.frames += frames,
            _ => {
                self.damaged_stretch_count += 1;
                if self.damaged_stretches.len() < MAX_INTERVALS {
                    self.damaged_stretches.push(DamagedInterval {
                        first_frame: index,
                        frames,
                        from_s: time_s,
                    });
                }
            }
        }
    }

    /// Removes gaps that were no damage. `really` is the number of frames that are lost nevertheless, at unknown
    /// positions.
    pub(crate) fn remove_gaps(&mut self, really: u64) {
        self.missing = really;
        self.expected = self.decoded + really;
        if really == 0 {
            self.damaged_stretches.clear();
            self.damaged_stretch_count = 0;
        }
    }

    /// Sets all counts to zero. The report of the previous part of the input already contains the frames so far.
    pub(crate) fn restart(&mut self) {
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
    fn neighbouring_losses_are_one_interval() {
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

    #[test]
    fn one_damage_is_one_warning() {
        let report = DecodeReport { expected: 90, decoded: 90, ..DecodeReport::default() };
        assert_eq!(report.damage_in_words(), None);
        let lost = DecodeReport { decoded: 78, missing: 12, damaged_stretch_count: 1, ..report };
        let words = lost.damage_in_words().unwrap();
        assert_eq!(words, "the input is damaged: 12 of 90 frames are lost, in 1 place");
        let cut = DecodeReport { cut_short: true, damaged_stretch_count: 2, broken_packets: 3, ..lost };
        let words = cut.damage_in_words().unwrap();
        assert_eq!(
            words,
            "the file is cut short: 12 of 90 frames are lost, in 2 places; 3 packets have broken slices, so their \
             pictures may be damaged"
        );
        let mut explained = DecodeReport::default();
        for index in 0..=MAX_WARNINGS as u64 {
            explained.left_out(index, index as f64, "it is no image");
            let is_listed = index < MAX_WARNINGS as u64;
            assert_eq!(explained.damage_in_words().is_none(), is_listed, "{index}");
        }
    }
}
