//! Selects the cars on which the keypoint net runs in each frame. A run of the net on a car is an observation.
//!
//! A moving car is observed as often as its trajectory needs. A stationary car is observed often at first. It is
//! observed rarely as soon as more observations would hardly improve the mean.

use roadplane_base::{CarRecord, CarRef, FrameRecord, PictureMotion, bbox_centre, bbox_iou};

/// Number of observations of a stationary car before they become rarer. Most of the error is a bias (0.6 of the sd).
/// Therefore more than a dozen observations improve the mean by only a few per cent.
const FIRST_OBSERVATIONS: u32 = 12;
/// Number of observations up to which the interval [`NEXT_S`] applies.
const NEXT_OBSERVATIONS: u32 = 24;
/// Interval between observations after the first [`FIRST_OBSERVATIONS`], s.
const NEXT_S: f64 = 2.0;
/// Interval between observations after the first [`NEXT_OBSERVATIONS`], s.
const LATER_S: f64 = 5.0;
/// Largest displacement of the box centre of a stationary car, as a share of the box's diagonal.
const STILL: f64 = 0.03;
/// Smallest intersection over union between the current box of a stationary car and its box in the last observation.
const SAME: f64 = 0.7;
/// Smallest intersection over union between the current box of a moving car and its previous box.
const FOLLOWS: f64 = 0.3;
/// Time without a detection after which a car is removed from the schedule, s.
const FORGOTTEN_S: f64 = 3.0;

/// The decision for a car in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Decision {
    /// The net runs on the car.
    Observe,
    /// The car keeps the pose of this earlier observation.
    CarryOver(CarRef),
    /// The net does not run on the car, because this earlier observation is too recent.
    Wait(CarRef),
    /// The car gets no pose, because the net does not suit the car or does not run on the frame.
    Skip,
}

/// An observed car. Its boxes are in px of the reference picture, on which the frames were registered.
#[derive(Clone, Debug)]
struct ObservedCar {
    /// Box in the last observation.
    bbox_px: [f64; 4],
    /// Box in the last frame in which the car was detected.
    found_px: [f64; 4],
    /// Last observation of the car.
    observation: CarRef,
    /// Time of the last observation, s.
    observed_s: f64,
    /// Number of observations in the current position.
    observations: u32,
    /// Time of the last frame in which the car was detected, s.
    found_s: f64,
}

/// The schedule of one clip, with the cars that were observed so far.
#[derive(Clone, Debug)]
pub struct Schedule {
    /// Smallest number of frames between two observations of a car.
    every: u64,
    cars: Vec<ObservedCar>,
    /// Reference of the boxes, and the mapping from it to the last picture.
    reference: Option<(u64, PictureMotion)>,
}

impl Schedule {
    /// Creates the schedule of a new clip. A car is observed at most once in `every` frames of the input.
    #[must_use]
    pub fn new(every: u64) -> Self {
        Self { every, cars: Vec::new(), reference: None }
    }

    /// Converts the boxes to the reference of a frame. Returns the mapping from the picture to the reference.
    ///
    /// A frame that was not registered is taken to lie where the last one lay.
    fn follow(&mut self, frame: &FrameRecord) -> PictureMotion {
        if let Some(watch) = &frame.watch
            && let Some(first) = watch.motion.first()
        {
            let size = frame.image_size_px;
            let now = (first.reference, first.picture_from_reference(size));
            if let Some((before, _)) = self.reference
                && before != now.0
            {
                match watch.registration_on(before) {
                    Some(registration) => {
                        let picture_from_before = registration.picture_from_reference(size);
                        let now_from_picture = now.1.inverse();
                        let change = |bbox: &[f64; 4]| {
                            now_from_picture.apply_to_box(&picture_from_before.apply_to_box(bbox))
                        };
                        for car in &mut self.cars {
                            (car.bbox_px, car.found_px) = (change(&car.bbox_px), change(&car.found_px));
                        }
                    }
                    None => self.cars.clear(),
                }
            }
            self.reference = Some(now);
        }
        self.reference
            .map_or(PictureMotion::IDENTITY, |(_, picture_from_reference)| picture_from_reference.inverse())
    }

    /// Returns the decision for every car of a frame. Frames must come in the order of time. `fits` returns whether the
    /// net suits a car.
    pub(crate) fn decisions(
        &mut self,
        frame: &FrameRecord,
        fits: impl Fn(&CarRecord) -> bool,
    ) -> Vec<Decision> {
        let time_s = frame.time_s;
        self.cars.retain(|earlier| time_s - earlier.found_s <= FORGOTTEN_S);
        let watch = frame.watch.as_ref();
        let is_inspected = watch.is_none_or(|watch| watch.looked);
        let reference_from_picture = self.follow(frame);
        let mut taken = vec![false; self.cars.len()];
        let mut decisions = Vec::with_capacity(frame.cars.len());
        for (index, car) in frame.cars.iter().enumerate() {
            let at_rest = reference_from_picture.apply_to_box(&car.bbox_px);
            let overlap = |earlier: &ObservedCar| bbox_iou(&earlier.found_px, &at_rest);
            let nearest = (0..taken.len())
                .filter(|&p| !taken[p] && overlap(&self.cars[p]) >= FOLLOWS)
                .max_by(|&a, &b| overlap(&self.cars[a]).total_cmp(&overlap(&self.cars[b])).then(b.cmp(&a)));
            let [x0, y0, x1, y1] = car.bbox_px;
            let is_still = |earlier: &ObservedCar| {
                let away = (bbox_centre(&earlier.bbox_px) - bbox_centre(&at_rest)).norm();
                bbox_iou(&earlier.bbox_px, &at_rest) >= SAME && away <= STILL * (x1 - x0).hypot(y1 - y0)
            };
            let observation = CarRef { frame: frame.frame, car: index };
            let observed = |observations: u32| ObservedCar {
                bbox_px: at_rest,
                found_px: at_rest,
                observation,
                observed_s: time_s,
                observations,
                found_s: time_s,
            };
            let decision = match nearest {
                Some(p) => {
                    taken[p] = true;
                    let earlier = &mut self.cars[p];
                    (earlier.found_px, earlier.found_s) = (at_rest, time_s);
                    let still = is_still(earlier);
                    let wait_s = match earlier.observations {
                        count if count < FIRST_OBSERVATIONS => 0.0,
                        count if count < NEXT_OBSERVATIONS => NEXT_S,
                        _ => LATER_S,
                    };
                    let is_early = frame.frame < earlier.observation.frame + self.every;
                    if car.held_since.is_none() && is_inspected && is_early {
                        Decision::Wait(earlier.observation)
                    } else if !is_inspected || is_early || (still && time_s - earlier.observed_s < wait_s) {
                        Decision::CarryOver(earlier.observation)
                    } else {
                        *earlier = observed(if still { earlier.observations + 1 } else { 1 });
                        Decision::Observe
                    }
                }
                None if is_inspected => {
                    self.cars.push(observed(1));
                    Decision::Observe
                }
                None => Decision::Skip,
            };
            decisions.push(match decision {
                Decision::Observe | Decision::CarryOver(_) if !fits(car) => Decision::Skip,
                decision => decision,
            });
        }
        decisions
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::ImageSize;

    fn frame(index: u64, x: f64) -> FrameRecord {
        let size = ImageSize { width: 640, height: 360 };
        let cars = vec![CarRecord::boxed([x, 100.0, x + 80.0, 150.0])];
        FrameRecord { cars, ..FrameRecord::empty(index, index as f64 * 0.1, size) }
    }

    fn observed_frames(frames: impl Iterator<Item = FrameRecord>) -> Vec<u64> {
        let mut schedule = Schedule::new(1);
        let mut observed = Vec::new();
        for frame in frames {
            match schedule.decisions(&frame, |_| true)[0] {
                Decision::Observe => observed.push(frame.frame),
                Decision::CarryOver(from) => assert_eq!(Some(&from.frame), observed.last()),
                Decision::Wait(_) | Decision::Skip => panic!("frame {}", frame.frame),
            }
        }
        observed
    }

    #[test]
    fn a_parked_car_is_observed_ever_more_rarely() {
        let seen = observed_frames((0..600).map(|i| frame(i, 100.0 + 0.5 * (i % 3) as f64)));
        assert_eq!(seen[..12], (0..12).collect::<Vec<_>>());
        assert!((24..40).contains(&seen.len()), "{seen:?}");
        assert!(seen.windows(2).all(|pair| pair[1] - pair[0] <= 51));
    }

    #[test]
    fn a_moving_car_waits_between_its_observations() {
        for fits in [true, false] {
            let mut schedule = Schedule::new(3);
            let decisions: Vec<Decision> =
                (0..9).flat_map(|i| schedule.decisions(&frame(i, 10.0 * i as f64), |_| fits)).collect();
            let own = if fits { Decision::Observe } else { Decision::Skip };
            let wait = |frame| Decision::Wait(CarRef { frame, car: 0 });
            let expected = [0, 3, 6].map(|frame| [own, wait(frame), wait(frame)]).concat();
            assert_eq!(decisions, expected);
        }
    }

    #[test]
    fn a_moving_car_is_observed_as_it_moves() {
        assert_eq!(observed_frames((0..50).map(|i| frame(i, 10.0 * i as f64))).len(), 50);
        let slow = observed_frames((0..100).map(|i| frame(i, 0.7 * i as f64)));
        assert!((20..95).contains(&slow.len()), "{slow:?}");
    }
}
