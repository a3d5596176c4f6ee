//! A known camera, what came of it, and what its cars say.

use super::cars::SeenCar;
use super::outcome::Outcome;
use roadplane_metrics::readers::cameras::ReferenceCamera;

/// Smallest cars of the cars' tables: longer side of the box, px.
pub(super) const LEAST_PX: f64 = 40.0;
/// An elevation that is off by more is another view of the car, rad.
pub(super) const ANOTHER_VIEW: f64 = 0.35;

/// A known camera, what came of it, and what its cars say.
pub(super) struct Measured {
    pub camera: ReferenceCamera,
    pub outcome: Outcome,
    pub cars: Vec<SeenCar>,
}

/// Cars that count in the tables.
pub(super) fn counted(measured: &Measured) -> impl Iterator<Item = &SeenCar> {
    measured.cars.iter().filter(|car| car.box_px >= LEAST_PX && car.errors[0].abs() < ANOTHER_VIEW)
}
