//! What a run cost, as `summary.json` has it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::digits::decimals;

/// What a run cost a frame read, and how much of the pictures its nets saw. A resumed run counts only its own work.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Speed {
    /// Frames read.
    pub frames: u64,
    /// Time that the input spans, s.
    pub clip_s: f64,
    /// Wall-clock time from the beginning to the report's end, s.
    pub wall_s: f64,
    /// Processor time a frame read, ms.
    pub cpu_ms_per_frame: CpuMs,
    /// Processor time over wall-clock time.
    pub cores_busy: f64,
    /// Share of the picture that the detector saw: mean over all frames read, those that nobody looked at counting 0.
    pub seen_share: f64,
    /// Frames in which the detector looked at something.
    pub looks: u64,
    /// Crops that the keypoint net saw.
    pub crops: u64,
}

/// Processor time a frame by stage, ms; the stages add up to the total, and nets are a part of their stages.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CpuMs {
    /// All of it.
    pub total: f64,
    /// Opening: the input's hash, loading the nets.
    pub open: f64,
    /// Decoding, with the decoder's own threads where no other input is worked on at the same time.
    pub decode: f64,
    /// Watching the picture.
    pub watch: f64,
    /// Finding vehicles.
    pub detect: f64,
    /// The detector's net alone.
    pub detect_net: f64,
    /// Finding keypoints.
    pub keypoints: f64,
    /// The keypoint net alone.
    pub keypoints_net: f64,
    /// Writing the records down, and frames for the report.
    pub spool: f64,
    /// The right half: cameras, poses, tracks.
    pub solve: f64,
    /// Result files and report.
    pub write: f64,
}

impl Speed {
    /// Frames read a second of wall-clock time.
    #[must_use]
    pub fn frames_per_s(&self) -> f64 {
        self.frames as f64 / self.wall_s.max(1e-9)
    }

    /// How many times faster than the input plays.
    #[must_use]
    pub fn times_real_time(&self) -> f64 {
        self.clip_s / self.wall_s.max(1e-9)
    }

    /// Looks of the detector a second of the input.
    #[must_use]
    pub fn looks_per_s(&self) -> f64 {
        self.looks as f64 / self.clip_s.max(1e-9)
    }

    /// Crops of the keypoint net a frame read.
    #[must_use]
    pub fn crops_per_frame(&self) -> f64 {
        self.crops as f64 / self.frames.max(1) as f64
    }

    /// As the file has it.
    pub(crate) fn rounded(&self) -> Self {
        let ms = &self.cpu_ms_per_frame;
        let cpu_ms_per_frame = CpuMs {
            total: decimals(ms.total, 4),
            open: decimals(ms.open, 4),
            decode: decimals(ms.decode, 4),
            watch: decimals(ms.watch, 4),
            detect: decimals(ms.detect, 4),
            detect_net: decimals(ms.detect_net, 4),
            keypoints: decimals(ms.keypoints, 4),
            keypoints_net: decimals(ms.keypoints_net, 4),
            spool: decimals(ms.spool, 4),
            solve: decimals(ms.solve, 4),
            write: decimals(ms.write, 4),
        };
        Self {
            clip_s: decimals(self.clip_s, 3),
            wall_s: decimals(self.wall_s, 3),
            cpu_ms_per_frame,
            cores_busy: decimals(self.cores_busy, 3),
            seen_share: decimals(self.seen_share, 5),
            ..self.clone()
        }
    }
}

impl CpuMs {
    /// Both nets.
    #[must_use]
    pub fn nets(&self) -> f64 {
        self.detect_net + self.keypoints_net
    }

    /// What the left half costs beyond decoding and the nets: watching, attention, crops, resampling, records.
    #[must_use]
    pub fn left_half_rest(&self) -> f64 {
        self.watch + self.detect + self.keypoints + self.spool - self.nets()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_beside_the_nets_is_neither_decoding_nor_solving() {
        let ms = CpuMs {
            total: 36.0,
            open: 1.0,
            decode: 10.0,
            watch: 2.0,
            detect: 8.0,
            detect_net: 7.0,
            keypoints: 5.0,
            keypoints_net: 4.5,
            spool: 1.0,
            solve: 6.0,
            write: 3.0,
        };
        assert!((ms.left_half_rest() - 4.5).abs() < 1e-12);
        let speed = Speed { frames: 100, clip_s: 10.0, wall_s: 4.0, looks: 20, ..Speed::default() };
        let numbers = [speed.frames_per_s(), speed.times_real_time(), speed.looks_per_s()];
        assert_eq!(numbers.map(|v| (v * 10.0).round() as i64), [250, 25, 20]);
    }
}
