//! Detects pictures without information: black, white, covered, frozen.

use roadplane_base::PictureVerdict;

use crate::SmallGrey;

/// Smallest range of grey levels (from the first to the 99th percentile) of a picture with content. A picture with a
/// smaller range is black, white or covered.
const MIN_RANGE: usize = 14;
/// A picture without content counts as black if its middle grey level is below this value.
const BLACK_BELOW: usize = 40;
/// A picture without content counts as white if its middle grey level is above this value. Between this limit and
/// [`BLACK_BELOW`], it counts as covered.
const WHITE_ABOVE: usize = 215;
/// Time without any change of the picture after which the video counts as frozen, s.
const FROZEN_S: f64 = 1.0;
/// Number of consecutive noisy pictures that must come before a freeze. Without this condition, a noise-free video of a
/// still scene would count as frozen.
const LIVELY: u32 = 20;
/// Smallest share of the runs of [`PIECE`] pixels that changes between two pictures of a noisy video.
const ALIVE: f64 = 0.5;
/// Number of consecutive pixels that are compared as one run.
const PIECE: usize = 16;

/// Detects pictures without information.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blindness {
    last: Option<SmallGrey>,
    /// Number of consecutive pictures with noise.
    lively: u32,
    same_since_s: Option<f64>,
}

impl Blindness {
    /// Checks the next picture. Returns the reason if the picture contains no information, and otherwise `None`.
    pub(crate) fn check(&mut self, picture: &SmallGrey, time_s: f64) -> Option<PictureVerdict> {
        let changed = self.last.as_ref().map_or(1.0, |last| share_changed(last, picture));
        self.last = Some(picture.clone());
        if changed > 0.0 {
            self.same_since_s = None;
            self.lively = if changed >= ALIVE { self.lively.saturating_add(1) } else { 0 };
        } else if self.same_since_s.is_none() {
            self.same_since_s = (self.lively >= LIVELY).then_some(time_s);
            self.lively = 0;
        }
        uniform(picture).or_else(|| {
            let frozen = self.same_since_s.is_some_and(|since| time_s - since >= FROZEN_S);
            frozen.then_some(PictureVerdict::Frozen)
        })
    }
}

fn share_changed(a: &SmallGrey, b: &SmallGrey) -> f64 {
    if !a.same_size(b) {
        return 1.0;
    }
    let pieces = a.values.chunks(PIECE).zip(b.values.chunks(PIECE));
    let total = pieces.len();
    pieces.filter(|(a, b)| a != b).count() as f64 / total.max(1) as f64
}

fn uniform(picture: &SmallGrey) -> Option<PictureVerdict> {
    let mut histogram = [0_usize; 256];
    for value in &picture.values {
        histogram[usize::from(*value)] += 1;
    }
    let count = picture.values.len();
    let below = |share: f64| {
        let wanted = (share * count as f64) as usize;
        let mut sum = 0;
        histogram.iter().position(|n| {
            sum += n;
            sum > wanted
        })
    };
    let (low, high) = (below(0.01)?, below(0.99)?);
    if high - low >= MIN_RANGE {
        return None;
    }
    Some(match (low + high) / 2 {
        middle if middle < BLACK_BELOW => PictureVerdict::Black,
        middle if middle > WHITE_ABOVE => PictureVerdict::White,
        _ => PictureVerdict::Covered,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(value: impl Fn(usize) -> u8) -> SmallGrey {
        SmallGrey { width: 40, height: 30, factor: 1, values: (0..1200).map(value).collect() }
    }

    #[test]
    fn an_empty_picture_is_black_white_or_covered() {
        for (grey, verdict) in
            [(3, PictureVerdict::Black), (250, PictureVerdict::White), (120, PictureVerdict::Covered)]
        {
            assert_eq!(uniform(&picture(|i| grey + (i % 4) as u8)), Some(verdict));
        }
        assert_eq!(uniform(&picture(|i| (i % 60) as u8)), None, "a dark picture that shows something");
    }

    #[test]
    fn only_a_live_picture_can_freeze() {
        let mut blindness = Blindness::default();
        let clean = picture(|i| (i % 200) as u8);
        for frame in 0..50 {
            assert_eq!(blindness.check(&clean, f64::from(frame) * 0.1), None, "a clean still picture");
        }
        for frame in 50..80_usize {
            let noisy = picture(|i| ((i + frame) % 200) as u8);
            assert_eq!(blindness.check(&noisy, frame as f64 * 0.1), None);
        }
        let stuck = picture(|i| ((i + 79) % 200) as u8);
        let verdicts: Vec<_> = (80..100).map(|f| blindness.check(&stuck, f64::from(f) * 0.1)).collect();
        assert_eq!(verdicts.iter().position(Option::is_some), Some(10), "{verdicts:?}");
    }
}
