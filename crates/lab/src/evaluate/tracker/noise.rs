//! Simulates measured boxes and keypoints of the vehicles in a truth file.

use std::fmt;

use nalgebra::Vector2;
use roadplane_base::{
    CarRecord, FrameRecord, ImageSize, KEYPOINTS, KeypointSet, PictureVerdict, VehicleClass, WatchRecord,
    bbox_iou,
};
use roadplane_synth::Rng;

use crate::evaluate::dataset::noisy_keypoints;
use roadplane_metrics::scoring::MIN_SIDE_PX;
use roadplane_metrics::truth::{TrueCar, TrueFrame, Truth};

/// Sizes and rates of the errors of simulated boxes and keypoints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// sd of the errors of keypoints and of boxes' edges, as a share of the box's longer side.
    pub keypoints: f64,
    /// Share of the vehicles that get no box.
    pub misses: f64,
    /// Number of boxes without a vehicle, as a share of the vehicles.
    pub false_boxes: f64,
    /// Share of boxes that get a wrong class.
    pub flips: f64,
    /// Share of boxes that get the keypoints of an overlapping vehicle.
    pub swaps: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self { keypoints: 0.02, misses: 0.1, false_boxes: 0.05, flips: 0.05, swaps: 0.05 }
    }
}

impl fmt::Display for Noise {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent =
            [self.keypoints, self.misses, self.false_boxes, self.flips, self.swaps].map(|v| 100.0 * v);
        let [keypoints, misses, wrong, flips, swaps] = percent;
        write!(f, "noise {keypoints:.1} % of the box, {misses:.0} % missed, {wrong:.0} % false boxes, ")?;
        write!(f, "{flips:.0} % wrong labels, {swaps:.0} % keypoints of another vehicle")
    }
}

/// Minimum visible share of a vehicle for the vehicle to get a simulated box.
const FOUND_SHARE: f64 = 0.2;
/// Minimum longer side of a vehicle's true box for the vehicle to get a simulated box, as a share of [`MIN_SIDE_PX`].
const FOUND_SIZE: f64 = 0.75;
/// Least overlap (IoU) of two boxes at which one box may get the keypoints of the other vehicle.
const NEAR_IOU: f64 = 0.1;
/// Range of the scores of boxes without a vehicle.
const FALSE_SCORES: [f64; 2] = [0.3, 0.6];

impl Noise {
    /// Returns one record for every `stride`-th frame, with simulated boxes and keypoints.
    #[must_use]
    pub fn measure(&self, truth: &Truth, stride: u32, seed: u64) -> Vec<FrameRecord> {
        let mut rng = Rng::new(seed);
        let frames = truth.frames.iter().filter(|frame| frame.frame.is_multiple_of(u64::from(stride.max(1))));
        frames.map(|frame| self.frame(truth, frame, &mut rng)).collect()
    }

    fn frame(&self, truth: &Truth, frame: &TrueFrame, rng: &mut Rng) -> FrameRecord {
        let size = truth.camera.image_size_px;
        let there: Vec<&TrueCar> = frame.cars.iter().filter(|car| is_found(car)).collect();
        let mut cars = Vec::new();
        for car in &there {
            if rng.unit() < self.misses {
                continue;
            }
            let other = there
                .iter()
                .find(|other| other.id != car.id && bbox_iou(&other.bbox_px, &car.bbox_px) > NEAR_IOU)
                .filter(|_| rng.unit() < self.swaps);
            let class = truth.model(car.id).map_or(VehicleClass::Car, |model| model.class);
            cars.push(CarRecord {
                score: (0.4 + 0.5 * car.visible_share + 0.05 * rng.normal()).clamp(0.25, 0.98),
                class: if rng.unit() < self.flips { flipped(class) } else { class },
                keypoints: keypoints(other.unwrap_or(car), self.keypoints, size, rng),
                ..CarRecord::boxed(self.moved(car, size, rng))
            });
        }
        for car in &there {
            if rng.unit() < self.false_boxes {
                cars.extend(self.false_car(car, size, rng));
            }
        }
        // The camera does not move. A run on pictures would give the same verdict.
        let watch =
            Some(WatchRecord { looked: true, verdict: PictureVerdict::Rest, ..WatchRecord::default() });
        FrameRecord { cars, watch, ..FrameRecord::empty(frame.frame, frame.time_s, size) }
    }

    /// Returns the car's box with noise on its edges. An edge on the picture's border gets no noise.
    fn moved(&self, car: &TrueCar, size: ImageSize, rng: &mut Rng) -> [f64; 4] {
        let sd_px = self.keypoints * side(&car.bbox_px);
        let ends = [size.width, size.height].map(|n| f64::from(n) - 0.5);
        std::array::from_fn(|i| {
            let at = car.bbox_px[i];
            let off = rng.normal() * sd_px;
            let cut = if i < 2 { at < 0.5 } else { at > ends[i - 2] - 1.0 };
            if cut { at } else { (at + off).clamp(-0.5, ends[i % 2]) }
        })
    }

    /// Returns a false detection: the box and the keypoints of the car `like`, shifted to a random position, with twice
    /// the noise.
    fn false_car(&self, like: &TrueCar, size: ImageSize, rng: &mut Rng) -> Option<CarRecord> {
        let [x0, y0, x1, y1] = like.bbox_px;
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let shift = Vector2::new(
            rng.uniform(0.0, (width - (x1 - x0)).max(1.0)) - x0,
            rng.uniform(0.0, (height - (y1 - y0)).max(1.0)) - y0,
        );
        let mut set = keypoints(like, 2.0 * self.keypoints, size, rng)?;
        for point in set.iter_mut().flatten() {
            point.pixel += shift;
        }
        Some(CarRecord {
            score: rng.uniform(FALSE_SCORES[0], FALSE_SCORES[1]),
            keypoints: Some(set),
            ..CarRecord::boxed([x0 + shift.x, y0 + shift.y, x1 + shift.x, y1 + shift.y])
        })
    }
}

fn is_found(car: &TrueCar) -> bool {
    car.visible_share >= FOUND_SHARE && side(&car.bbox_px) >= FOUND_SIZE * MIN_SIDE_PX
}

fn side([x0, y0, x1, y1]: &[f64; 4]) -> f64 {
    (x1 - x0).max(y1 - y0)
}

/// Returns the keypoints of a car with noise; `None` if no keypoint is in the picture.
fn keypoints(car: &TrueCar, noise: f64, size: ImageSize, rng: &mut Rng) -> Option<Box<KeypointSet>> {
    let set: KeypointSet = noisy_keypoints(car, noise, size, rng);
    set.iter().any(Option::is_some).then(|| Box::new(set) as Box<[_; KEYPOINTS]>)
}

/// Returns the wrong class that a vehicle of this class gets.
fn flipped(class: VehicleClass) -> VehicleClass {
    match class {
        VehicleClass::Car | VehicleClass::Bus => VehicleClass::Truck,
        VehicleClass::Truck | VehicleClass::Motorcycle => VehicleClass::Car,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_metrics::truth::fixture::lot;

    #[test]
    fn shares_are_as_given_and_the_same_each_time() {
        let truth = lot(400);
        let noise = Noise::default();
        let frames = noise.measure(&truth, 1, 5);
        assert_eq!(frames, noise.measure(&truth, 1, 5));
        let there = truth.frames.iter().map(|frame| frame.cars.iter().filter(|c| is_found(c)).count());
        let there = there.sum::<usize>() as f64;
        let cars = || frames.iter().flat_map(|frame| &frame.cars);
        let share = |count: usize| count as f64 / there;
        // There are three cars in a frame. One in ten is missed, and there is one false box for twenty cars.
        assert!((share(cars().count()) - 0.95).abs() < 0.03, "{}", share(cars().count()));
        let trucks = cars().filter(|car| car.class == VehicleClass::Truck).count();
        assert!((share(trucks) - 0.045).abs() < 0.02, "{}", share(trucks));
        assert_eq!(noise.measure(&truth, 4, 5).len(), 100);
    }
}
