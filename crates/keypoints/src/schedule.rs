//! Which cars the net looks at: moving ones whenever they have moved enough to tell something new, standing ones until more looks
//! would hardly improve their mean, then now and then.

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
/// Least overlap with the box of the look, intersection over union.
const SAME: f64 = 0.7;
/// A place where no car was found for so long is forgotten, s.
const FORGOTTEN_S: f64 = 3.0;

/// What becomes of a car in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// The net looks at it.
    Look,
    /// Its last look still holds.
    Hold(CarRef),
    /// It is left without a pose.
    Pass,
}

/// A place where a car was looked at; px of the frame at rest.
#[derive(Clone, Debug)]
struct Place {
    bbox_px: [f64; 4],
    look: CarRef,
    look_s: f64,
    looks: u32,
    found_s: f64,
}

/// What is remembered of cars in the frames before.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    places: Vec<Place>,
}

impl Schedule {
    /// Decides for every car of a frame that `fits`, in the order of time.
    pub(crate) fn turns(&mut self, frame: &FrameRecord, fits: impl Fn(&CarRecord) -> bool) -> Vec<Turn> {
        let time_s = frame.time_s;
        self.places.retain(|place| time_s - place.found_s <= FORGOTTEN_S);
        let watch = frame.watch.as_ref();
        let is_looked = watch.is_none_or(|watch| watch.looked);
        let offset = watch.map_or(Vector2::zeros(), WatchRecord::offset);
        let mut taken = vec![false; self.places.len()];
        let mut turns = Vec::with_capacity(frame.cars.len());
        for (index, car) in frame.cars.iter().enumerate() {
            if !fits(car) {
                turns.push(Turn::Pass);
                continue;
            }
            let at_rest = bbox_moved(&car.bbox_px, &-offset);
            let overlap = |place: &Place| bbox_iou(&place.bbox_px, &at_rest);
            let nearest = (0..taken.len()).filter(|&p| !taken[p] && overlap(&self.places[p]) >= SAME).max_by(
                |&a, &b| overlap(&self.places[a]).total_cmp(&overlap(&self.places[b])).then(b.cmp(&a)),
            );
            let [x0, y0, x1, y1] = car.bbox_px;
            let moved = |place: &Place| {
                let away = (bbox_centre(&place.bbox_px) - bbox_centre(&at_rest)).norm();
                away > STILL * (x1 - x0).hypot(y1 - y0)
            };
            let own = CarRef { frame: frame.frame, car: index };
            let turn = match nearest {
                Some(p) => {
                    taken[p] = true;
                    let place = &mut self.places[p];
                    place.found_s = time_s;
                    let still = !moved(place);
                    let wait_s = match place.looks {
                        looks if looks < FIRST_LOOKS => 0.0,
                        looks if looks < NEXT_LOOKS => NEXT_S,
                        _ => LATER_S,
                    };
                    if !is_looked || (still && time_s - place.look_s < wait_s) {
                        Turn::Hold(place.look)
                    } else {
                        let looks = if still { place.looks + 1 } else { 1 };
                        *place =
                            Place { bbox_px: at_rest, look: own, look_s: time_s, looks, found_s: time_s };
                        Turn::Look
                    }
                }
                None if is_looked => {
                    self.places.push(Place {
                        bbox_px: at_rest,
                        look: own,
                        look_s: time_s,
                        looks: 1,
                        found_s: time_s,
                    });
                    Turn::Look
                }
                None => Turn::Pass,
            };
            turns.push(turn);
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
        let mut schedule = Schedule::default();
        let mut looks = Vec::new();
        for frame in frames {
            match schedule.turns(&frame, |_| true)[0] {
                Turn::Look => looks.push(frame.frame),
                Turn::Hold(look) => assert_eq!(Some(&look.frame), looks.last()),
                Turn::Pass => panic!("frame {}", frame.frame),
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
    fn a_moving_car_is_looked_at_as_it_moves() {
        assert_eq!(looks((0..50).map(|i| frame(i, 10.0 * i as f64))).len(), 50);
        let slow = looks((0..100).map(|i| frame(i, 0.7 * i as f64)));
        assert!((20..95).contains(&slow.len()), "{slow:?}");
    }
}
