//! A reference camera with the estimated camera and the cars in the picture.

use super::cars::SeenCar;
use super::outcome::Outcome;
use roadplane_metrics::readers::cameras::ReferenceCamera;

/// Minimum length of the longer side of a car's box for the tables to include the car, px.
pub(super) const LEAST_PX: f64 = 40.0;
/// Largest elevation error at which the tables include a car, rad. With a larger error, the fit found a wrong view of
/// the car.
pub(super) const ANOTHER_VIEW: f64 = 0.35;

/// A reference camera, the outcome of the run on its media, and the cars in the first frame.
pub(super) struct Measured {
    pub camera: ReferenceCamera,
    pub outcome: Outcome,
    pub cars: Vec<SeenCar>,
}

/// Returns the cars that the tables include: cars that are large enough and were not fitted in a wrong view.
pub(super) fn counted(measured: &Measured) -> impl Iterator<Item = &SeenCar> {
    measured.cars.iter().filter(|car| car.box_px >= LEAST_PX && car.errors[0].abs() < ANOTHER_VIEW)
}
