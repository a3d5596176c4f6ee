//! Chooses the inference frames (the frames on which the nets run) and the times when the nets discard their state.

use roadplane_base::FrameStamp;
use roadplane_decode::{Input, InputKind};

use crate::Config;

/// Chooses the inference frames (the frames on which the nets run) and the times when the nets discard their state.
///
/// The choice depends only on a frame's index and on its time in the input. A run over a piece of the input, or a
/// resumed run, therefore chooses the same frames as a run over the whole input.
#[derive(Clone, Copy, Debug)]
pub struct Cadence {
    /// Distance from one inference frame to the next, in frames of the input.
    every: u64,
    /// Least distance between two runs of the keypoint net on the same car, in frames of the input.
    pub(crate) crops_every: u64,
    /// Number of inference frames in which the detector's full scan covers the whole picture once.
    pub(crate) frames_per_scan: u64,
    /// Largest number of inference frames from one fine pass of the detector to the next.
    pub(crate) frames_per_fine: u64,
    /// Whether region-of-interest scheduling is on.
    pub(crate) uses_regions: bool,
}

/// Size from which a picture counts as large: the number of pixels of the detector's input, summed over all passes but
/// the fine one.
///
/// On smaller pictures, the detector runs more often at the same total cost. With more runs, the detector is more
/// likely to find a vehicle that it misses on some frames. With the default passes, pictures of 1024 px or more are
/// large.
const LARGE_PX: f64 = 1e6;

/// Longest time between two fine passes of the detector, s. A new track needs three detections within half a second.
const FINE_S: f64 = 0.25;

/// Time after which the detector and the keypoint net discard their state, s of the input.
///
/// The state is discarded at each multiple of this time. A resumed run starts at such a multiple, where no earlier
/// state is needed.
pub const RESET_S: f64 = 60.0;

/// Returns the number of the interval that contains a time. Intervals are [`RESET_S`] long and are counted from 0.
#[must_use]
pub fn interval_of(time_s: f64) -> u64 {
    (time_s / RESET_S).max(0.0) as u64
}

/// Returns the distance between two runs of the detector, and between two runs of the keypoint net on a car, in frames
/// of the input.
///
/// `frames` is the setting `watch.look_s`, converted to frames. `stride` is the distance between two frames that are
/// read. `input_px` is the number of pixels of the detector's input for one picture. The size of the picture matters
/// only for the detector, because the keypoint net costs the same for all pictures.
fn frames_per_inference(frames: f64, stride: u64, input_px: f64) -> (u64, u64) {
    let multiple = |of: u64, frames: f64| of * (frames / of as f64).round().clamp(1.0, 1e6) as u64;
    let every = multiple(stride, frames * (input_px / LARGE_PX).min(1.0));
    (every, multiple(every, frames))
}

impl Cadence {
    /// Returns the cadence for an input, according to the configuration.
    #[must_use]
    pub fn of(input: &Input, config: &Config) -> Self {
        let watch = &config.watch;
        let stride = u64::from(config.decode.stride.max(1));
        // The frame rate of a folder of pictures is unknown, so every picture is an inference frame.
        let frames = match input.kind() {
            InputKind::Video(_) if watch.attention => watch.look_s * input.nominal_fps(),
            _ => 0.0,
        };
        let size = input.size();
        let (every, crops_every) =
            frames_per_inference(frames, stride, config.detect.input_px(size.width, size.height));
        let interval_s = every as f64 / input.nominal_fps().max(1e-3);
        let frames_per_scan = (watch.sweep_s / interval_s).round().clamp(1.0, 1e6) as u64;
        // Pictures of a folder may be far apart in time.
        let frames_per_fine = if frames > 0.0 { (FINE_S / interval_s).max(1.0) as u64 } else { 1 };
        Self { every, crops_every, frames_per_scan, frames_per_fine, uses_regions: watch.attention }
    }

    /// Returns the distance from one inference frame to the next, in frames of the input.
    #[must_use]
    pub fn every(&self) -> u64 {
        self.every
    }

    /// Returns the number of the last inference frame up to the frame with this index, counted from 0 at the start of
    /// the input.
    pub(crate) fn number(&self, index: u64) -> u64 {
        index / self.every
    }

    /// Returns a function that decides whether a frame is an inference frame. The function must be called for all
    /// frames in order. If an inference frame is missing from the input, the next frame replaces it.
    pub fn chooser(self) -> impl FnMut(&FrameStamp) -> bool + Send {
        let mut last = None;
        move |stamp| {
            let number = self.number(stamp.index);
            last.replace(number) != Some(number)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_detector_runs_more_often_on_small_pictures_and_the_keypoint_net_does_not() {
        let frames = |fps: f64| 0.11 * fps;
        assert_eq!(frames_per_inference(frames(30.0), 1, 1.67e6), (3, 3));
        assert_eq!(frames_per_inference(frames(30.0), 1, 0.23e6), (1, 3));
        assert_eq!(frames_per_inference(frames(25.0), 1, 0.75e6), (2, 2), "a whole multiple");
        assert_eq!(frames_per_inference(frames(30.0), 12, 0.23e6), (12, 12));
        assert_eq!(frames_per_inference(0.0, 2, 1.67e6), (2, 2), "pictures of a folder");
    }
}
