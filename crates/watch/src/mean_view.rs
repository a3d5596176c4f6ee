//! The mean position of the pictures on a keyframe.

use roadplane_base::{Homography, RegisteredLens, Registration};

use crate::View;

/// Time over which the mean is taken, s.
const AVERAGED_S: f64 = 20.0;

/// The mean position of the last pictures on a keyframe. A camera that sways has about the same mean position in all
/// clips.
#[derive(Clone, Debug, Default)]
pub(crate) struct MeanView {
    /// Mean numbers of the homographies from the keyframe to the pictures.
    numbers: [f64; 8],
    /// Mean distortion of the displaced pictures, and their number.
    distortion: (f64, f64),
    /// Time that the mean covers, at most [`AVERAGED_S`], and the time of the last picture, s.
    covered: Option<(f64, f64)>,
}

impl MeanView {
    /// Adds the next picture. It counts for the time since the last one.
    pub(crate) fn add(&mut self, view: &View, time_s: f64) {
        let share = match self.covered {
            None => {
                self.covered = Some((0.0, time_s));
                1.0
            }
            Some((covered_s, last_s)) => {
                let elapsed_s = (time_s - last_s).max(0.0);
                let covered_s = (covered_s + elapsed_s).min(AVERAGED_S);
                self.covered = Some((covered_s, time_s));
                if covered_s > 0.0 { (elapsed_s / covered_s).min(1.0) } else { 0.0 }
            }
        };
        let numbers = view.picture_from_keyframe.homography.numbers();
        self.numbers.iter_mut().zip(numbers).for_each(|(mean, number)| *mean += (number - *mean) * share);
        if view.is_displaced() {
            let (mean, count) = &mut self.distortion;
            *count += 1.0;
            *mean += (view.distortion() - *mean) / *count;
        }
    }

    /// Returns the registration of the mean position on the frame `reference`.
    pub(crate) fn registration(&self, reference: u64) -> Registration {
        let mean = Homography::from_numbers(self.numbers).unwrap_or(Homography::IDENTITY);
        let is_displaced = self.distortion.1 > 0.0;
        let lens = RegisteredLens { bend: self.distortion.0, sd: 0.0, change: [0.0; 8] };
        Registration {
            reference,
            homography: is_displaced.then(|| mean.rounded_numbers()),
            sd_px: 0.0,
            lens: is_displaced.then_some(lens),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use roadplane_base::{ImageSize, Lens, PictureMotion};

    #[test]
    fn a_picture_after_a_long_gap_counts_once() {
        let size = ImageSize { width: 640, height: 360 };
        let at = |x: f64| {
            let shift = Homography::from_numbers([1.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0]).unwrap();
            View::new(Some(0), PictureMotion::new(shift, Lens::STRAIGHT, size), size)
        };
        let mut mean = MeanView::default();
        mean.add(&at(0.0), 0.0);
        mean.add(&at(0.0), 10.0);
        mean.add(&at(1.0), 310.0);
        assert!((mean.numbers[2] - 1.0).abs() < 1e-12, "{:?}", mean.numbers);
    }

    #[test]
    fn a_sway_has_its_middle_as_mean_position() {
        let size = ImageSize { width: 640, height: 360 };
        let mut mean = MeanView::default();
        for i in 0..300 {
            let x = 7.0 + 12.0 * (0.2 * f64::from(i)).sin();
            let shift = Homography::from_numbers([1.0, 0.0, x, 0.0, 1.0, -2.0, 0.0, 0.0]).unwrap();
            let view = View::new(Some(0), PictureMotion::new(shift, Lens::STRAIGHT, size), size);
            mean.add(&view, 0.1 * f64::from(i));
        }
        let motion = mean.registration(0).picture_from_reference(size);
        let at = motion.apply(&Vector2::new(100.0, 200.0));
        assert!((at - Vector2::new(107.0, 198.0)).norm() < 1.0, "{at}");
        let mut rest = MeanView::default();
        rest.add(&View::new(Some(0), PictureMotion::IDENTITY, size), 0.0);
        assert!(rest.registration(0).homography.is_none());
    }
}
