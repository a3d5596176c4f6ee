//! A track before smoothing, and when two sightings are of one car.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use roadplane_base::{VehicleClass, bbox_covered, bbox_iou};

use crate::{CarMeasurement, measurement::Observation, shape::ShapeSum};

/// Two vehicles' middles are never nearer than this, m; overlap of boxes with which it holds for measurements.
pub(crate) const NEVER_NEARER_M: f64 = 1.0;
pub(crate) const LEAST_OVERLAP: f64 = 0.2;

/// A track before smoothing.
#[derive(Clone, Debug)]
pub(crate) struct RawTrack {
    pub observations: Vec<Observation>,
    pub shape: ShapeSum,
    votes: BTreeMap<VehicleClass, f64>,
    dims: DimsSum,
}

/// Classes that are voted for.
pub(crate) const VOTES: usize = 3;
/// Share of the votes that makes a car: detectors take cars for trucks more often than trucks for cars.
const CAR_SHARE: f64 = 0.4;
/// What is lower and shorter is a car, whatever it is called, m.
const MAX_CAR_HEIGHT_M: f64 = 1.8;
const MAX_CAR_LENGTH_M: f64 = 5.5;
/// What a box that is called a car, but shows no car's keypoints, counts.
const UNSURE_VOTE: f64 = 0.5;

/// Sizes that boxes showed, weighted by their precision.
#[derive(Clone, Copy, Debug, Default)]
struct DimsSum {
    weighted: Vector3<f64>,
    precision: Vector3<f64>,
}

impl DimsSum {
    fn add(&mut self, car: &CarMeasurement) {
        if let Some([dims, sd]) = car.dims_m {
            let precision = sd.map(|sd| sd.max(0.05).powi(-2));
            self.weighted += dims.component_mul(&precision);
            self.precision += precision;
        }
    }

    fn mean(&self) -> Option<Vector3<f64>> {
        (self.precision.min() > 0.0).then(|| self.weighted.component_div(&self.precision))
    }
}

impl RawTrack {
    pub(crate) fn new(car: &CarMeasurement, observation: Observation, shape: ShapeSum) -> Self {
        let mut track =
            Self { observations: Vec::new(), shape, votes: BTreeMap::new(), dims: DimsSum::default() };
        track.add(car, observation);
        track
    }

    pub(crate) fn add(&mut self, car: &CarMeasurement, observation: Observation) {
        let unsure = car.from_box && car.class == VehicleClass::Car;
        *self.votes.entry(car.class).or_default() += car.score * if unsure { UNSURE_VOTE } else { 1.0 };
        self.dims.add(car);
        self.observations.push(observation);
    }

    /// Goes on as another.
    pub(crate) fn append(&mut self, later: Self) {
        self.observations.extend(later.observations);
        self.shape.append(later.shape);
        for (class, votes) in later.votes {
            *self.votes.entry(class).or_default() += votes;
        }
        self.dims.weighted += later.dims.weighted;
        self.dims.precision += later.dims.precision;
    }

    /// Scores of the looks that took it for each class.
    pub(crate) fn votes(&self) -> [f64; VOTES] {
        use VehicleClass::{Bus, Car, Truck};
        [Car, Truck, Bus].map(|class| self.votes.get(&class).copied().unwrap_or(0.0))
    }

    /// Size of a vehicle that is no car, m.
    pub(crate) fn dims_m(&self) -> Option<Vector3<f64>> {
        if self.class() == VehicleClass::Car { None } else { self.dims.mean() }
    }

    pub(crate) fn class(&self) -> VehicleClass {
        let [car, truck, bus] = self.votes();
        if self.dims.mean().is_some_and(|dims| dims.z < MAX_CAR_HEIGHT_M && dims.x < MAX_CAR_LENGTH_M) {
            return VehicleClass::Car;
        }
        if car >= CAR_SHARE * (car + truck + bus) {
            VehicleClass::Car
        } else if truck >= bus {
            VehicleClass::Truck
        } else {
            VehicleClass::Bus
        }
    }
}

/// Two measurements of one car: boxes that overlap much, at about the same place.
pub(crate) fn same_car(a: &Observation, b: &Observation) -> bool {
    let iou = bbox_iou(&a.bbox_px, &b.bbox_px);
    let overlap = iou > 0.5 || bbox_covered(&a.bbox_px, &b.bbox_px) > 0.8;
    let in_one_place = iou > LEAST_OVERLAP && (a.pose.xy() - b.pose.xy()).norm() < NEVER_NEARER_M;
    in_one_place || (overlap && share_space(a, b))
}

/// Whether the two could not stand there side by side: nearer than a car is wide, or not told apart by their covariances.
pub(crate) fn share_space(a: &Observation, b: &Observation) -> bool {
    let away = a.pose.xy() - b.pose.xy();
    let spread = (a.covariance + b.covariance).fixed_view::<2, 2>(0, 0).into_owned();
    away.norm() < 1.6 || spread.try_inverse().is_some_and(|s| away.dot(&(s * away)) < 4.0)
}
