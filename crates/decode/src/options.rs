//! Options of the decoder: the frames to decode, and limits.

use serde::{Deserialize, Serialize};

use crate::DecodeError;

/// Frame rate of a folder of images if the user gives none, 1/s.
pub const ASSUMED_IMAGE_FPS: f64 = 30.0;

/// Options of the decoder: the frames to decode, and limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DecodeOptions {
    /// Stride of the delivered frames: only every `stride`-th frame of the input is delivered (1: all frames).
    pub stride: u32,
    /// Start of the delivered part, s from the start of the input.
    pub start_s: f64,
    /// End of the delivered part, s from the start of the input. A frame at this time is not delivered. `None` means
    /// the end of the input.
    pub end_s: Option<f64>,
    /// Largest number of frames that are delivered.
    pub max_frames: Option<u64>,
    /// Largest number of pixels of a picture (width × height).
    pub max_pixels: u64,
    /// Highest frame rate that is accepted from a stream, 1/s. The frame rate is used only if the stream has no times.
    pub max_fps: f64,
    /// Frame rate of folders of images, 1/s. `None`: [`ASSUMED_IMAGE_FPS`], with a warning.
    pub image_fps: Option<f64>,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        Self {
            stride: 1,
            start_s: 0.0,
            end_s: None,
            max_frames: None,
            max_pixels: 4096 * 4096,
            max_fps: 240.0,
            image_fps: None,
        }
    }
}

impl DecodeOptions {
    pub(crate) fn check(&self) -> Result<(), DecodeError> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let fail = |what: &str| Err(DecodeError::Option { what: what.to_owned() });
        if self.stride == 0 {
            return fail("stride must be at least 1");
        }
        if self.max_frames == Some(0) {
            return fail("max_frames must be at least 1");
        }
        if !(positive(self.max_fps) && self.image_fps.is_none_or(positive)) {
            return fail("frame rates must be positive");
        }
        if !(self.start_s.is_finite() && self.start_s >= 0.0) || self.end_s.is_some_and(|end| end.is_nan()) {
            return fail("start and end must be times in seconds from the start of the input");
        }
        Ok(())
    }

    /// Returns the frame rate of folders of images, 1/s.
    pub(crate) fn image_rate(&self) -> f64 {
        self.image_fps.unwrap_or(ASSUMED_IMAGE_FPS)
    }

    /// Returns how many of `frames` frames at the steady rate `fps` are chosen.
    pub(crate) fn chosen_of(&self, frames: u64, fps: f64) -> u64 {
        // Frame i has the time i / fps; the float casts saturate.
        let before = |time_s: f64| ((time_s * fps - 1e-6).ceil().max(0.0) as u64).min(frames);
        let (from, to) = (before(self.start_s), self.end_s.map_or(frames, before));
        let stride = u64::from(self.stride.max(1));
        let chosen = to.div_ceil(stride).saturating_sub(from.div_ceil(stride));
        self.max_frames.map_or(chosen, |most| chosen.min(most))
    }

    /// Decides whether a frame is delivered. `handed_on` is the number of frames that were delivered before.
    pub(crate) fn verdict(&self, index: u64, pts_nanos: i64, handed_on: u64) -> Verdict {
        let time_s = pts_nanos as f64 * 1e-9;
        let over = self.max_frames.is_some_and(|most| handed_on >= most)
            || self.end_s.is_some_and(|end| time_s >= end);
        if over {
            Verdict::Over
        } else if time_s < self.start_s || !index.is_multiple_of(u64::from(self.stride)) {
            Verdict::Skip
        } else {
            Verdict::Take
        }
    }
}

/// The decision on a frame; see [`DecodeOptions::verdict`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Take,
    Skip,
    Over,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stride_start_and_end_choose_frames() {
        let options = DecodeOptions {
            stride: 3,
            start_s: 1.0,
            end_s: Some(2.0),
            max_frames: Some(4),
            ..DecodeOptions::default()
        };
        assert_eq!(options.verdict(12, 1_200_000_000, 0), Verdict::Take);
        assert_eq!(options.verdict(13, 1_300_000_000, 0), Verdict::Skip);
        assert_eq!(options.verdict(9, 900_000_000, 0), Verdict::Skip);
        assert_eq!(options.verdict(21, 2_000_000_000, 0), Verdict::Over);
        assert_eq!(options.verdict(12, 1_200_000_000, 4), Verdict::Over);
        for (stride, start_s, end_s) in
            [(3, 1.0, Some(2.0)), (1, 0.0, None), (7, 2.5, None), (2, 0.3, Some(0.3))]
        {
            let options = DecodeOptions { stride, start_s, end_s, ..DecodeOptions::default() };
            let taken = |i: &u64| options.verdict(*i, *i as i64 * 100_000_000, 0) == Verdict::Take;
            assert_eq!(options.chosen_of(97, 10.0), (0..97).filter(taken).count() as u64, "{options:?}");
        }
        let few = DecodeOptions { max_frames: Some(2), ..options };
        assert_eq!(few.chosen_of(97, 10.0), 2);
        assert!(DecodeOptions { stride: 0, ..DecodeOptions::default() }.check().is_err());
        assert!(DecodeOptions { image_fps: Some(f64::NAN), ..DecodeOptions::default() }.check().is_err());
    }
}
