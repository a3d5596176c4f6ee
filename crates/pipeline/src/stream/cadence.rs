//! Which frames are inference frames, and when the nets' state of earlier frames is discarded.

use roadplane_base::FrameStamp;
use roadplane_decode::{Input, InputKind};

use crate::Config;

/// Which frames are inference frames, and when the nets' state of earlier frames is discarded.
///
/// Both depend only on a frame's index and time in the input. So a run over a piece, or a run that continues after a
/// stop, chooses the same frames as a run over the whole input.
#[derive(Clone, Copy, Debug)]
pub struct Cadence {
    /// Frames of the input per inference frame.
    every: u64,
    /// The keypoint net runs on a car at most once in this many frames.
    pub(crate) crops_every: u64,
    /// Inference frames within which the full scan covers the picture.
    pub(crate) frames_per_scan: u64,
    /// Whether region-of-interest scheduling is on.
    pub(crate) uses_regions: bool,
}

/// Size of a large picture, px of the detector's input in all passes together.
///
/// The detector runs in proportion more often on smaller pictures, at the same cost. It then has more chances to find a
/// vehicle that it misses on some frames. With the default passes, pictures of 1024 px or more are large.
const LARGE_PX: f64 = 1e6;

/// Interval after which the state of the detector and the keypoint net is discarded, s of the input.
///
/// A resumed run starts again at such a time, and no state is older than this.
pub const RESET_S: f64 = 60.0;

/// Returns the number, from 0, of the interval of [`RESET_S`] that contains a time.
#[must_use]
pub fn interval_of(time_s: f64) -> u64 {
    (time_s / RESET_S).max(0.0) as u64
}

/// Returns the frames per inference frame of the detector and of the keypoint net.
///
/// `frames` is `watch.look_s` in frames. The detector's input is `input_px` of a picture. The keypoint net costs the
/// same for small pictures as for large ones.
fn frames_per_inference(frames: f64, stride: u64, input_px: f64) -> (u64, u64) {
    let multiple = |of: u64, frames: f64| of * (frames / of as f64).round().clamp(1.0, 1e6) as u64;
    let every = multiple(stride, frames * (input_px / LARGE_PX).min(1.0));
    (every, multiple(every, frames))
}

impl Cadence {
    /// Returns the cadence of an input by the configuration.
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
        Self { every, crops_every, frames_per_scan, uses_regions: watch.attention }
    }

    /// Returns the frames of the input per inference frame.
    #[must_use]
    pub fn every(&self) -> u64 {
        self.every
    }

    /// Returns the number of a frame's inference frame, counted from the start of the input.
    pub(crate) fn number(&self, index: u64) -> u64 {
        index / self.every
    }

    /// Returns a function that decides whether a frame is an inference frame; call it for all frames in order. Where
    /// frames are missing, the first frame that is there is chosen.
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
