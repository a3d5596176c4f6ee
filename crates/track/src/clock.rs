//! Estimates when the pictures of a clip were taken.
//!
//! Time stamps are often wrong: a network delays pictures, and a recorder repeats or drops some. In such a clip, all
//! vehicles seem to jump and to stop at the same moments. Where their steps agree, the picture was taken earlier or
//! later than its time stamp says.

use std::cmp::Ordering;

use roadplane_base::{FrameRecord, bbox_cut, interpolated};

use crate::{
    Detection,
    delays::{DelayVariance, Delays},
    frames::BoxesByFrame,
    picture_chains::chains,
};

/// Least time between two pictures, as a share of the time between their time stamps. It keeps their order.
const LEAST_SHARE: f64 = 0.2;
/// Number of boxes and frames that are kept until their delays are estimated. It bounds the memory of long clips to
/// about 100 MB.
const MOST: usize = 200_000;

/// Time stamp of an inference frame, s, and the time from it to the moment at which the picture was taken, s.
type Picture = (f64, f64);

/// Returns a picture with this time stamp and delay (s), but not before the picture of the last inference frame.
fn after(last: Option<&Picture>, time_s: f64, delay_s: f64) -> Picture {
    let least_s = last.map_or(f64::NEG_INFINITY, |(last_s, last_delay_s)| {
        last_s + last_delay_s + LEAST_SHARE * (time_s - last_s).max(0.0) - time_s
    });
    (time_s, delay_s.max(least_s))
}

/// The clock of a clip: when its pictures were taken, as far as vehicles show it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clock {
    /// Pictures of the inference frames, in the order of time. Empty if all time stamps are right.
    pictures: Vec<Picture>,
    /// Sd of the delays, s; zero if the time stamps are right.
    pub sd_s: f64,
}

impl Clock {
    /// Returns the time from a time stamp (s) to the moment at which the picture was taken, s. Between inference
    /// frames, it is interpolated.
    #[must_use]
    pub fn delay_s(&self, time_s: f64) -> f64 {
        interpolated(&self.pictures, time_s)
    }
}

/// Reads the frames of a clip for its [`Clock`].
#[derive(Default)]
pub struct ClockReader {
    /// Time stamps of the inference frames whose delays are not estimated yet, s.
    times_s: Vec<f64>,
    /// Their boxes.
    boxes: BoxesByFrame,
    /// Number of these frames and boxes.
    count: usize,
    /// Index of the place that the last frame shows.
    place: Option<usize>,
    /// Variance of the delays, from all frames so far.
    variance: DelayVariance,
    pictures: Vec<Picture>,
}

impl ClockReader {
    /// Adds the next frame, in the order of time.
    pub fn add(&mut self, frame: &FrameRecord) {
        if frame.watch.as_ref().is_some_and(|watch| !watch.looked) {
            return;
        }
        // Boxes of another place lie in another picture.
        let place = frame.watch.as_ref().and_then(|watch| watch.place);
        if std::mem::replace(&mut self.place, place) != place {
            self.estimate();
        }
        let picture_px = frame.picture_px();
        let mut boxes: Vec<Detection> = frame
            .cars
            .iter()
            .filter(|car| !car.is_carried_over())
            .filter(|car| bbox_cut(&car.bbox_px, &picture_px) == [false; 4])
            .map(|car| Detection::uncut(car.bbox_px, car.score, car.class))
            .collect();
        // The order of the cars in a frame has no effect.
        boxes.sort_by(|a, b| a.bbox_px.partial_cmp(&b.bbox_px).unwrap_or(Ordering::Equal));
        self.add_boxes(frame.time_s, boxes);
    }

    /// Adds the boxes of the next inference frame.
    fn add_boxes(&mut self, time_s: f64, boxes: Vec<Detection>) {
        self.count += 1 + boxes.len();
        if !boxes.is_empty() {
            self.boxes.insert(self.times_s.len(), boxes);
        }
        self.times_s.push(time_s);
        if self.count >= MOST {
            self.estimate();
        }
    }

    /// Estimates the delays of the frames so far.
    fn estimate(&mut self) {
        let (times_s, boxes) = (std::mem::take(&mut self.times_s), std::mem::take(&mut self.boxes));
        self.count = 0;
        let delays = Delays::of(&chains(&boxes, &[], &times_s, 0.0), &times_s);
        self.variance.add(&delays);
        let found = self.variance.sd_s().map(|sd_s| delays.estimate(sd_s));
        for (i, time_s) in times_s.into_iter().enumerate() {
            let delay_s = found.as_ref().map_or(0.0, |delays| delays[i]);
            self.pictures.push(after(self.pictures.last(), time_s, delay_s));
        }
    }

    /// Returns the clock.
    #[must_use]
    pub fn finish(mut self) -> Clock {
        self.estimate();
        match self.variance.sd_s() {
            Some(sd_s) => Clock { pictures: self.pictures, sd_s },
            None => Clock::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use roadplane_base::VehicleClass;

    use super::*;

    const INTERVAL_S: f64 = 0.1;

    /// Returns numbers in −1…1 that look random.
    fn noise(i: usize, of: usize) -> f64 {
        let mixed = (i as u64 * 1_000_003 + of as u64 * 7919 + 12_345).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        ((mixed ^ (mixed >> 29)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Returns the boxes at a time (s) of vehicles that drive from left to right. Box errors are shares of their size.
    fn boxes(vehicles: usize, time_s: f64, frame: usize, error: f64) -> Vec<Detection> {
        let one = |vehicle: usize| {
            let off = |axis: usize| 90.0 * error * noise(frame, 2 * vehicle + axis);
            let left = 50.0 + (150.0 + 20.0 * vehicle as f64) * time_s + 6.0 * time_s * time_s + off(0);
            let top = 200.0 * vehicle as f64 + off(1);
            Detection::uncut([left, top, left + 90.0, top + 60.0], 0.8, VehicleClass::Car)
        };
        (0..vehicles).map(one).collect()
    }

    /// Returns the clock of 8 s in which the pictures were taken at other times than their time stamps say.
    fn clock(vehicles: usize, error: f64, taken_s: impl Fn(usize) -> f64) -> Clock {
        let mut reader = ClockReader::default();
        for frame in 0..80 {
            reader.add_boxes(frame as f64 * INTERVAL_S, boxes(vehicles, taken_s(frame), frame, error));
        }
        reader.finish()
    }

    #[test]
    fn wrong_time_stamps_are_corrected() {
        let delay_s = |frame: usize| 0.045 * noise(frame, 99);
        let found = clock(4, 0.02, |frame| frame as f64 * INTERVAL_S + delay_s(frame));
        let frames = 10..70;
        let rms = |off: &dyn Fn(usize) -> f64| {
            let mean = frames.clone().map(off).sum::<f64>() / frames.len() as f64;
            (frames.clone().map(|i| (off(i) - mean).powi(2)).sum::<f64>() / frames.len() as f64).sqrt()
        };
        let before = rms(&delay_s);
        let after = rms(&|frame| found.delay_s(frame as f64 * INTERVAL_S) - delay_s(frame));
        assert!((found.sd_s / before - 1.0).abs() < 0.4, "{} {before}", found.sd_s);
        assert!(after < 0.55 * before, "{after} {before}");
    }

    #[test]
    fn right_time_stamps_stay_as_they_are() {
        for error in [0.0, 0.01, 0.05] {
            let found = clock(4, error, |frame| frame as f64 * INTERVAL_S);
            assert_eq!(found, Clock::default(), "{error}");
            assert_eq!(found.delay_s(3.0), 0.0);
        }
    }

    #[test]
    fn one_vehicle_shows_no_delays() {
        assert_eq!(clock(1, 0.01, |frame| (frame / 2 * 2) as f64 * INTERVAL_S), Clock::default());
    }

    #[test]
    fn repeated_pictures_are_taken_at_nearly_the_same_time() {
        let found = clock(3, 0.01, |frame| (frame / 2 * 2) as f64 * INTERVAL_S);
        let taken_s = |frame: usize| frame as f64 * INTERVAL_S + found.delay_s(frame as f64 * INTERVAL_S);
        for frame in (20..60).step_by(2) {
            let (repeat, next) =
                (taken_s(frame + 1) - taken_s(frame), taken_s(frame + 2) - taken_s(frame + 1));
            assert!((0.0..0.4 * INTERVAL_S).contains(&repeat) && next > 1.6 * INTERVAL_S, "{repeat} {next}");
        }
    }

    #[test]
    fn pictures_keep_their_order_and_delays_are_interpolated() {
        let mut clock = Clock { pictures: Vec::new(), sd_s: 0.1 };
        for (time_s, delay_s) in [(0.0, 0.1), (1.0, -2.0), (2.0, -0.2)] {
            clock.pictures.push(after(clock.pictures.last(), time_s, delay_s));
        }
        let delays = [-1.0, 0.0, 0.5, 1.0, 2.0, 3.0].map(|time_s| clock.delay_s(time_s));
        for (found, expected) in delays.into_iter().zip([0.1, 0.1, -0.3, -0.7, -0.2, -0.2]) {
            assert!((found - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn odd_time_stamps_do_no_harm() {
        for stamps_s in [&[][..], &[1.0], &[0.0; 40], &[1e300, -1e300, 0.0, 5.0], &[f64::MAX; 12]] {
            let mut reader = ClockReader::default();
            for (frame, time_s) in stamps_s.iter().enumerate() {
                reader.add_boxes(*time_s, boxes(4, frame as f64 * INTERVAL_S, frame, 0.01));
            }
            assert_eq!(reader.finish(), Clock::default());
        }
        let mut backwards = ClockReader::default();
        for frame in 0..80 {
            backwards.add_boxes(-(frame as f64), boxes(4, frame as f64 * INTERVAL_S, frame, 0.01));
        }
        assert_eq!(backwards.finish(), Clock::default());
    }
}
