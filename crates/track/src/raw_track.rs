//! Tracks before smoothing, and the tests whether two detections are of one car.

use nalgebra::{SVector, Vector3};
use roadplane_base::{VehicleClass, bbox_iou};
use roadplane_measure::body_of;

use crate::{
    CarMeasurement, Detection, expected::SURE_OVERLAP, measurement::Observation, noise::SIGNIFICANT,
    shape::ShapeSum, vehicle::HALF_WHEELBASE_M,
};

/// Least number of detections, coincidences or steps that are more than chance.
pub(crate) const FEWEST: usize = 3;

/// A track before smoothing.
#[derive(Clone, Debug, Default)]
pub(crate) struct RawTrack {
    /// Detections, in the order of time.
    pub observations: Vec<Observation>,
    /// Evidence on the vehicle's shape.
    pub shape: ShapeSum,
    /// Sum of the scores for each class.
    pub votes: Votes,
    /// Evidence on the vehicle's size.
    pub dims: DimsSum,
    /// Joins of tracklets, in the order of time.
    pub links: Vec<Link>,
    /// Number of detections without a measurement.
    pub seen_again: usize,
    /// Number of boxes without a tracklet of which the detector is certain. Those that are carried over do not count.
    pub certain: usize,
    /// Whether all of it was chained in the picture, from boxes that no tracklet has.
    pub is_boxed: bool,
}

/// A join of two tracklets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Link {
    /// Frame of the later tracklet's first detection.
    pub frame: usize,
    /// Logarithm of the odds against all alternatives that linking had.
    pub log_odds: f64,
}

/// One number per class, in the order of [`VehicleClass::ALL`].
pub(crate) type Votes = SVector<f64, { VehicleClass::ALL.len() }>;

/// Sizes from boxes, weighted by their precision.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct DimsSum {
    /// Sum of the sizes times their precisions, 1/m.
    weighted: Vector3<f64>,
    /// Sum of the precisions, 1/m².
    precision: Vector3<f64>,
}

impl DimsSum {
    /// Sums sizes with their sds, m.
    pub(crate) fn of<'a>(all: impl Iterator<Item = &'a [Vector3<f64>; 2]>) -> Self {
        let mut sum = Self::default();
        all.for_each(|dims| sum.add(dims));
        sum
    }

    /// Adds a size with its sd, m.
    fn add(&mut self, [dims, sd]: &[Vector3<f64>; 2]) {
        let precision = sd.map(|sd| sd.powi(-2));
        self.weighted += dims.component_mul(&precision);
        self.precision += precision;
    }

    /// Returns the weighted mean of the sizes, m; `None` without any.
    pub(crate) fn mean(&self) -> Option<Vector3<f64>> {
        (self.precision.min() > 0.0).then(|| self.weighted.component_div(&self.precision))
    }
}

impl RawTrack {
    /// Creates a track of a vehicle that only boxes show, from detections that were placed on the ground. Boxes of which
    /// the detector is certain vote for a class. `None` without detections.
    pub(crate) fn by_boxes(
        observations: Vec<Observation>,
        boxes: &[(usize, Detection)],
        dims: DimsSum,
    ) -> Option<Self> {
        let (votes, is_boxed) = (votes_of(boxes), true);
        let certain = boxes.iter().filter(|(_, seen)| seen.is_sure() && !seen.carried_over).count();
        let track = Self { observations, votes, dims, certain, is_boxed, ..Self::default() };
        (!track.observations.is_empty()).then_some(track)
    }

    /// Adds a measurement to the end of the track.
    pub(crate) fn add(&mut self, car: &CarMeasurement, observation: Observation) {
        self.votes += vote(car.detection.class, car.detection.score);
        if let Some(dims) = &car.dims_m {
            self.dims.add(dims);
        }
        self.observations.push(observation);
    }

    /// Inserts detections at frames in which the track has none.
    pub(crate) fn insert(&mut self, found: &[Observation]) {
        self.observations.extend_from_slice(found);
        self.observations.sort_by_key(|seen| seen.frame);
    }

    /// Appends a track that continues this one.
    pub(crate) fn append(&mut self, later: Self) {
        self.observations.extend(later.observations);
        self.links.extend(later.links);
        self.seen_again += later.seen_again;
        self.certain += later.certain;
        self.is_boxed &= later.is_boxed;
        self.shape.append(later.shape);
        self.votes += later.votes;
        self.dims.weighted += later.dims.weighted;
        self.dims.precision += later.dims.precision;
    }

    /// Returns the size of a vehicle that is no car, m.
    pub(crate) fn dims_m(&self) -> Option<Vector3<f64>> {
        if self.class() == VehicleClass::Car { None } else { self.dims.mean() }
    }

    /// Returns the distance from the rear axle to the vehicle's origin, m. It grows with the vehicle's length.
    pub(crate) fn half_wheelbase_m(&self) -> f64 {
        let car_m = body_of(VehicleClass::Car).dims_m;
        self.dims_m().map_or(HALF_WHEELBASE_M, |dims_m| HALF_WHEELBASE_M * dims_m.x / car_m.x)
    }

    /// Returns the class by votes and size.
    pub(crate) fn class(&self) -> VehicleClass {
        let [car, truck, bus, motorcycle] = self.votes.into();
        if motorcycle > car + truck + bus {
            return VehicleClass::Motorcycle;
        }
        let largest_car_m = body_of(VehicleClass::Car).at_sds_m(SIGNIFICANT);
        // No bus is so low, and from high above cars are classed as buses.
        let lowest_bus_m = body_of(VehicleClass::Bus).at_sds_m(-SIGNIFICANT);
        let height_m = if bus > truck { lowest_bus_m.z } else { largest_car_m.z };
        if self.dims.mean().is_some_and(|dims| dims.z < height_m && dims.x < largest_car_m.x) {
            return VehicleClass::Car;
        }
        if car >= truck + bus {
            VehicleClass::Car
        } else if truck >= bus {
            VehicleClass::Truck
        } else {
            VehicleClass::Bus
        }
    }
}

/// Returns the sum of the scores for each class, over the boxes of which the detector is certain.
pub(crate) fn votes_of(boxes: &[(usize, Detection)]) -> Votes {
    let sure = boxes.iter().map(|(_, seen)| seen).filter(|seen| seen.is_sure());
    sure.map(|seen| vote(seen.class, seen.score)).sum()
}

/// Returns the votes of one detection.
fn vote(class: VehicleClass, score: f64) -> Votes {
    VehicleClass::ALL.map(|one| if one == class { score } else { 0.0 }).into()
}

/// Whether two detections are of one car: their boxes overlap much, at about the same position.
pub(crate) fn same_car(a: &Observation, b: &Observation) -> bool {
    let [a_px, b_px] = [a, b].map(|seen| &seen.detection.bbox_px);
    in_one_place(&a.pose, a_px, &b.pose, b_px) || (bbox_iou(a_px, b_px) > SURE_OVERLAP && share_space(a, b))
}

/// Whether cars in two poses (x, y, heading) would share more than half of their ground, and their boxes overlap.
pub(crate) fn in_one_place(a: &Vector3<f64>, a_px: &[f64; 4], b: &Vector3<f64>, b_px: &[f64; 4]) -> bool {
    // The heading of either may be wrong.
    let shared = || covered_ground(a, b).min(covered_ground(b, a));
    bbox_iou(a_px, b_px) > 0.0 && 2.0 * shared() > 1.0
}

/// Returns the share of a car's ground that another car with the same heading would cover, 0–1.
fn covered_ground(car: &Vector3<f64>, other: &Vector3<f64>) -> f64 {
    let (away, (sin, cos)) = (other.xy() - car.xy(), car.z.sin_cos());
    let [ahead, aside] = [away.x * cos + away.y * sin, away.y * cos - away.x * sin];
    let car_m = body_of(VehicleClass::Car).dims_m;
    (1.0 - ahead.abs() / car_m.x).max(0.0) * (1.0 - aside.abs() / car_m.y).max(0.0)
}

/// Whether two detections are too near for two cars side by side. They are nearer than a car is wide, or their
/// covariances do not separate them.
fn share_space(a: &Observation, b: &Observation) -> bool {
    let away = a.pose.xy() - b.pose.xy();
    let spread = (a.covariance + b.covariance).fixed_view::<2, 2>(0, 0).into_owned();
    away.norm() < body_of(VehicleClass::Car).dims_m.y
        || spread.try_inverse().is_some_and(|s| away.dot(&(s * away)) < SIGNIFICANT * SIGNIFICANT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn cars_share_a_place_lengthwise_from_farther_apart_than_sideways() {
        let box_px = [100.0, 100.0, 160.0, 140.0];
        let one = |away: [f64; 2], turned: f64, axis: f64| {
            let (sin, cos) = axis.sin_cos();
            let place = [3.0 + away[0] * cos - away[1] * sin, 20.0 + away[0] * sin + away[1] * cos];
            let (a, b) = (Vector3::new(3.0, 20.0, axis), Vector3::new(place[0], place[1], axis + turned));
            let shared = in_one_place(&a, &box_px, &b, &box_px);
            assert_eq!(shared, in_one_place(&b, &box_px, &a, &box_px));
            let elsewhere_px = [160.0, 100.0, 220.0, 140.0];
            assert!(!in_one_place(&a, &box_px, &b, &elsewhere_px));
            shared
        };
        for axis in [0.0, 0.7, 2.0] {
            assert!(one([2.1, 0.0], 0.0, axis) && !one([2.4, 0.0], 0.0, axis), "lengthwise");
            assert!(one([0.0, 0.8], PI, axis) && !one([0.0, 1.0], PI, axis), "sideways");
            assert!(one([0.8, 0.0], FRAC_PI_2, axis) && !one([2.3, 0.0], FRAC_PI_2, axis), "across");
        }
    }

    #[test]
    fn what_is_small_is_a_car_whatever_it_is_called() {
        let class = |called, dims_m: [f64; 3]| {
            let dims = DimsSum::of([[Vector3::from(dims_m), Vector3::repeat(0.3)]].iter());
            RawTrack { votes: vote(called, 1.0), dims, ..RawTrack::default() }.class()
        };
        use VehicleClass::{Bus, Car, Motorcycle, Truck};
        assert_eq!(class(Motorcycle, [2.0, 0.8, 1.6]), Motorcycle);
        assert_eq!([Truck, Bus].map(|called| class(called, [4.6, 1.8, 1.6])), [Car, Car]);
        // This is a van, or a car that is seen from high above.
        assert_eq!([Truck, Bus].map(|called| class(called, [5.1, 1.9, 2.0])), [Truck, Car]);
        assert_eq!([Truck, Bus].map(|called| class(called, [6.5, 2.1, 2.6])), [Truck, Bus]);
    }
}
