//! The processing time and the amount of work of a run, as in `summary.json`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::digits::decimals;

/// The processing time and the amount of work of a run. A run that continues a stopped run counts only its own work.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Speed {
    /// Number of frames read.
    pub frames: u64,
    /// Duration of the input, s.
    pub clip_s: f64,
    /// Wall-clock time from the start of the run to the end of the report, s.
    pub wall_s: f64,
    /// Processor time of each stage per frame read, ms.
    pub cpu_ms_per_frame: CpuMs,
    /// Mean number of busy processor cores: the processor time divided by the wall-clock time.
    #[schemars(range(min = 0))]
    pub cores_busy: f64,
    /// Share of the picture's area on which the detector ran, 0 to 1. It is the mean over all frames read. A frame on
    /// which the detector did not run counts as 0.
    #[schemars(range(min = 0, max = 1))]
    pub seen_share: f64,
    /// Number of frames on which the detector ran.
    pub looks: u64,
    /// Number of crops on which the keypoint net ran.
    pub crops: u64,
}

/// Processor time of each stage per frame read, ms. The times of the stages add up to `total`. `detect_net` is a part
/// of `detect`, and `keypoints_net` is a part of `keypoints`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CpuMs {
    /// All stages together, ms per frame.
    pub total: f64,
    /// Start of the run, ms per frame: hashing the input and loading the nets.
    pub open: f64,
    /// Decoding of the input, ms per frame. The decoder's own threads are included only if the process works on a
    /// single input.
    pub decode: f64,
    /// Measurement of camera motion and of changes in the picture, ms per frame.
    pub watch: f64,
    /// Vehicle detection, including the detector's net, ms per frame.
    pub detect: f64,
    /// The detector's net alone, ms per frame.
    pub detect_net: f64,
    /// Keypoint detection, including the keypoint net, ms per frame.
    pub keypoints: f64,
    /// The keypoint net alone, ms per frame.
    pub keypoints_net: f64,
    /// Writing the records of the frames and storing frames for the report, ms per frame.
    pub spool: f64,
    /// Estimation of cameras, poses and tracks, ms per frame.
    pub solve: f64,
    /// Writing the result files and the report, ms per frame.
    pub write: f64,
}

impl Speed {
    /// Returns the number of frames read per second of wall-clock time.
    #[must_use]
    pub fn frames_per_s(&self) -> f64 {
        self.frames as f64 / self.wall_s.max(1e-9)
    }

    /// Returns the speed as a multiple of real time: the duration of the input divided by the wall-clock time.
    #[must_use]
    pub fn times_real_time(&self) -> f64 {
        self.clip_s / self.wall_s.max(1e-9)
    }

    /// Returns the number of frames on which the detector ran, per second of the input.
    #[must_use]
    pub fn inference_frames_per_s(&self) -> f64 {
        self.looks as f64 / self.clip_s.max(1e-9)
    }

    /// Returns the number of crops on which the keypoint net ran, per frame read.
    #[must_use]
    pub fn crops_per_frame(&self) -> f64 {
        self.crops as f64 / self.frames.max(1) as f64
    }

    /// Returns a copy with its numbers rounded to the decimals that `summary.json` has.
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
    /// Returns the processor time of the detector's net and the keypoint net together, ms per frame.
    #[must_use]
    pub fn nets(&self) -> f64 {
        self.detect_net + self.keypoints_net
    }

    /// Returns the processor time of perception without decoding and without the nets, ms per frame.
    ///
    /// It covers the measurement of camera motion, scheduling, crops, resampling and the records of frames.
    #[must_use]
    pub fn perception_rest(&self) -> f64 {
        self.watch + self.detect + self.keypoints + self.spool - self.nets()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rest_of_perception_contains_no_decoding_and_no_solving() {
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
        assert!((ms.perception_rest() - 4.5).abs() < 1e-12);
        let speed = Speed { frames: 100, clip_s: 10.0, wall_s: 4.0, looks: 20, ..Speed::default() };
        let numbers = [speed.frames_per_s(), speed.times_real_time(), speed.inference_frames_per_s()];
        assert_eq!(numbers.map(|v| (v * 10.0).round() as i64), [250, 25, 20]);
    }
}
