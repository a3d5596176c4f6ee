//! Which cars the net looks at: moving ones as often as their trajectory needs, standing ones until more looks would hardly improve
//! their mean, then now and then.

use nalgebra::Vector2;
use roadplane_base::{CarRecord, CarRef, FrameRecord, WatchRecord, bbox_centre, bbox_iou, bbox_moved};

/// Looks at a standing car in a row: of an error of which bias makes up the larger part (0.6 of the sd), the mean of a dozen looks
/// leaves no more than a few per cent to gain.
const FIRST_LOOKS: u32 = 12;
/// Looks after that are so far apart, s, up to the next number of looks; then …
const NEXT_LOOKS: u32 = 24;
const NEXT_S: f64 = 2.0;
/// … so far.
const LATER_S: f64 = 5.0;
/// A box whose centre stayed within this share of its diagonal shows a car that has not moved.
const STILL: f64 = 0.03;
/// Least overlap of a standing car with the box of the look, intersection over union …
const SAME: f64 = 0.7;
/// … and of a moving one with where it was found last.
const FOLLOWS: f64 = 0.3;
/// A place where no car was found for so long is forgotten, s.
const FORGOTTEN_S: f64 = 3.0;

/// What becomes of a car in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// The net looks at it.
    Look,
    /// Its last look still holds.
    Hold(CarRef),
    /// It was looked at so shortly before that another look would tell nothing new.
    Wait(CarRef),
    /// It is left without a pose: it is none that the net is for, or nobody looks.
    Pass,
}

/// A place where a car was looked at; px of the frame at rest.
#[derive(Clone, Debug)]
struct Place {
    /// In the look, and where it was found last.
    bbox_px: [f64; 4],
    found_px: [f64; 4],
    look: CarRef,
    look_s: f64,
    looks: u32,
    found_s: f64,
}

/// What is remembered of cars in the frames before.
#[derive(Clone, Debug)]
pub struct Schedule {
    /// A car is looked at at most once in so many frames.
    every: u64,
    places: Vec<Place>,
}

impl Schedule {
    /// Before the first frame; a car is looked at at most once in `every` frames of the input.
    #[must_use]
    pub fn new(every: u64) -> Self {
        Self { every, places: Vec::new() }
    }

    /// Decides for every car of a frame, in the order of time; the net is for those that `fits` says.
    pub(crate) fn turns(&mut self, frame: &FrameRecord, fits: impl Fn(&CarRecord) -> bool) -> Vec<Turn> {
        let time_s = frame.time_s;
        self.places.retain(|place| time_s - place.found_s <= FORGOTTEN_S);
        let watch = frame.watch.as_ref();
        let is_looked = watch.is_none_or(|watch| watch.looked);
        let offset = watch.map_or(Vector2::zeros(), WatchRecord::offset);
        let mut taken = vec![false; self.places.len()];
        let mut turns = Vec::with_capacity(frame.cars.len());
        for (index, car) in frame.cars.iter().enumerate() {
            let at_rest = bbox_moved(&car.bbox_px, &-offset);
            let overlap = |place: &Place| bbox_iou(&place.found_px, &at_rest);
            let nearest =
                (0..taken.len()).filter(|&p| !taken[p] && overlap(&self.places[p]) >= FOLLOWS).max_by(
                    |&a, &b| overlap(&self.places[a]).total_cmp(&overlap(&self.places[b])).then(b.cmp(&a)),
                );
            let [x0, y0, x1, y1] = car.bbox_px;
            let is_still = |place: &Place| {
                let away = (bbox_centre(&place.bbox_px) - bbox_centre(&at_rest)).norm();
                bbox_iou(&place.bbox_px, &at_rest) >= SAME && away <= STILL * (x1 - x0).hypot(y1 - y0)
            };
            let look = CarRef { frame: frame.frame, car: index };
            let looked = |looks: u32| Place {
                bbox_px: at_rest,
                found_px: at_rest,
                look,
                look_s: time_s,
                looks,
                found_s: time_s,
            };
            let turn = match nearest {
                Some(p) => {
                    taken[p] = true;
                    let place = &mut self.places[p];
                    (place.found_px, place.found_s) = (at_rest, time_s);
                    let still = is_still(place);
                    let wait_s = match place.looks {
                        looks if looks < FIRST_LOOKS => 0.0,
                        looks if looks < NEXT_LOOKS => NEXT_S,
                        _ => LATER_S,
                    };
                    let is_early = frame.frame < place.look.frame + self.every;
                    if car.held_since.is_none() && is_looked && is_early {
                        Turn::Wait(place.look)
                    } else if !is_looked || is_early || (still && time_s - place.look_s < wait_s) {
                        Turn::Hold(place.look)
                    } else {
                        *place = looked(if still { place.looks + 1 } else { 1 });
                        Turn::Look
                    }
                }
                None if is_looked => {
                    self.places.push(looked(1));
                    Turn::Look
                }
                None => Turn::Pass,
            };
            turns.push(match turn {
                Turn::Look | Turn::Hold(_) if !fits(car) => Turn::Pass,
                turn => turn,
            });
        }
        turns
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

    fn looks(frames: impl Iterator<Item = FrameRecord>) -> Vec<u64> {
        let mut schedule = Schedule::new(1);
        let mut looks = Vec::new();
        for frame in frames {
            match schedule.turns(&frame, |_| true)[0] {
                Turn::Look => looks.push(frame.frame),
                Turn::Hold(look) => assert_eq!(Some(&look.frame), looks.last()),
                Turn::Wait(_) | Turn::Pass => panic!("frame {}", frame.frame),
            }
        }
        looks
    }

    #[test]
    fn a_parked_car_is_looked_at_ever_more_rarely() {
        let seen = looks((0..600).map(|i| frame(i, 100.0 + 0.5 * (i % 3) as f64)));
        assert_eq!(seen[..12], (0..12).collect::<Vec<_>>());
        assert!((24..40).contains(&seen.len()), "{seen:?}");
        assert!(seen.windows(2).all(|pair| pair[1] - pair[0] <= 51));
    }

    #[test]
    fn whatever_moves_waits_between_its_looks() {
        for fits in [true, false] {
            let mut schedule = Schedule::new(3);
            let turns: Vec<Turn> =
                (0..9).flat_map(|i| schedule.turns(&frame(i, 10.0 * i as f64), |_| fits)).collect();
            let own = if fits { Turn::Look } else { Turn::Pass };
            let wait = |frame| Turn::Wait(CarRef { frame, car: 0 });
            let expected = [0, 3, 6].map(|look| [own, wait(look), wait(look)]).concat();
            assert_eq!(turns, expected);
        }
    }

    #[test]
    fn a_moving_car_is_looked_at_as_it_moves() {
        assert_eq!(looks((0..50).map(|i| frame(i, 10.0 * i as f64))).len(), 50);
        let slow = looks((0..100).map(|i| frame(i, 0.7 * i as f64)));
        assert!((20..95).contains(&slow.len()), "{slow:?}");
    }
}
