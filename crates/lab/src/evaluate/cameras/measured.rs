//! A reference camera, the estimated one, and its cars.

use super::cars::SeenCar;
use super::outcome::Outcome;
use roadplane_metrics::readers::cameras::ReferenceCamera;

/// Least size of a car that the tables count, px: the longer side of its box.
pub(super) const LEAST_PX: f64 = 40.0;
/// Largest error of elevation of a car that the tables count, rad. Beyond it, the car was fitted in another view.
pub(super) const ANOTHER_VIEW: f64 = 0.35;

/// A reference camera, the outcome of its run, and its cars.
pub(super) struct Measured {
    pub camera: ReferenceCamera,
    pub outcome: Outcome,
    pub cars: Vec<SeenCar>,
}

/// Returns the cars that count in the tables.
pub(super) fn counted(measured: &Measured) -> impl Iterator<Item = &SeenCar> {
    measured.cars.iter().filter(|car| car.box_px >= LEAST_PX && car.errors[0].abs() < ANOTHER_VIEW)
}
