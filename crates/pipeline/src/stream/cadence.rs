//! When pictures are looked at, and when what is remembered of them ends.

use roadplane_base::FrameStamp;
use roadplane_decode::{Input, InputKind};

use crate::Config;

/// When pictures are looked at, and when what is remembered of them ends: by a frame's place and time in the input alone, so
/// that runs that begin elsewhere, or go on after a stop, agree.
#[derive(Clone, Copy, Debug)]
pub struct Cadence {
    /// Every so many frames of the input one is looked at.
    every: u64,
    /// The keypoint net sees a car at most once in so many frames.
    pub(crate) crops_every: u64,
    /// Looks within which the sweep covers the picture.
    pub(crate) looks_a_sweep: u64,
    /// Whether the detector looks at parts only.
    pub(crate) attention: bool,
}

/// Pictures of which the detector sees less than so many px of its input, in all passes together, are looked at more often in
/// proportion, at the same cost: a vehicle that it finds now and then only is then found when it does. With the default passes
/// pictures from 1024 px on are large.
const LARGE_PX: f64 = 1e6;

/// What detector and keypoint net remember is thrown away this often, s of the input: a resumed run begins again there, and memory
/// of anything is at most so old.
pub const FORGET_S: f64 = 60.0;

/// Number of the stretch of [`FORGET_S`] that a time lies in.
#[must_use]
pub fn stretch_of(time_s: f64) -> u64 {
    (time_s / FORGET_S).max(0.0) as u64
}

/// Frames from look to look of the detector, which sees `input_px` of a picture, and of the keypoint net, which is as dear for
/// small pictures as for large ones; `frames` are those of `watch.look_s`.
fn beat(frames: f64, stride: u64, input_px: f64) -> (u64, u64) {
    let multiple = |of: u64, frames: f64| of * (frames / of as f64).round().clamp(1.0, 1e6) as u64;
    let every = multiple(stride, frames * (input_px / LARGE_PX).min(1.0));
    (every, multiple(every, frames))
}

impl Cadence {
    /// As the configuration says, for an input of this kind and rate.
    #[must_use]
    pub fn of(input: &Input, config: &Config) -> Self {
        let watch = &config.watch;
        let stride = u64::from(config.decode.stride.max(1));
        // The rate of a folder's pictures is not known: each may be worth a look.
        let frames = match input.kind() {
            InputKind::Video(_) if watch.attention => watch.look_s * input.nominal_fps(),
            _ => 0.0,
        };
        let size = input.size();
        let (every, crops_every) = beat(frames, stride, config.detect.input_px(size.width, size.height));
        let look_s = every as f64 / input.nominal_fps().max(1e-3);
        let looks_a_sweep = (watch.sweep_s / look_s).round().clamp(1.0, 1e6) as u64;
        Self { every, crops_every, looks_a_sweep, attention: watch.attention }
    }

    /// Frames of the input from look to look.
    #[must_use]
    pub fn every(&self) -> u64 {
        self.every
    }

    /// Number of the look that a frame belongs to, counted from the input's start.
    pub(crate) fn number(&self, index: u64) -> u64 {
        index / self.every
    }

    /// Says of each frame, in order, whether it is looked at: the first of every look, also where frames are missing.
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
    fn small_pictures_are_looked_at_more_often_and_cars_as_often() {
        let look = |fps: f64| 0.11 * fps;
        assert_eq!(beat(look(30.0), 1, 1.67e6), (3, 3));
        assert_eq!(beat(look(30.0), 1, 0.23e6), (1, 3));
        assert_eq!(beat(look(25.0), 1, 0.75e6), (2, 2), "whole looks");
        assert_eq!(beat(look(30.0), 12, 0.23e6), (12, 12));
        assert_eq!(beat(0.0, 2, 1.67e6), (2, 2), "pictures of a folder");
    }
}
