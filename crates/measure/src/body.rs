//! Sizes of vehicles.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{Shape, ShapeAtlas, VehicleClass};

/// Least length, width and height of a fitted body, m. A shorter side may become half as long.
const LEAST_M: f64 = 1.0;
/// Least sd of a track's size when the size is used for other detections of the vehicle, m.
const AT_BEST_SD_M: f64 = 0.3;

/// Correlation of length and height of trucks and buses: vans are short and low, lorries and coaches long and high.
const LENGTH_HEIGHT: f64 = 0.5;

/// The size of a vehicle with its uncertainty.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Class of the vehicle.
    pub class: VehicleClass,
    /// Length, width and height, m.
    pub dims_m: Vector3<f64>,
    /// Covariance of length, width and height, m².
    pub covariance: Matrix3<f64>,
}

/// Returns the mean size of a class and its uncertainty (types of road vehicles, EU; width without mirrors).
#[must_use]
pub fn body_of(class: VehicleClass) -> Body {
    let (dims, sd) = match class {
        VehicleClass::Car => ([4.5, 1.8, 1.55], [0.4, 0.1, 0.15]),
        VehicleClass::Truck => ([7.5, 2.4, 3.0], [2.5, 0.2, 0.6]),
        VehicleClass::Bus => ([11.0, 2.5, 3.1], [2.0, 0.1, 0.25]),
        // With its riders; estimates.
        VehicleClass::Motorcycle => ([2.05, 0.8, 1.6], [0.2, 0.12, 0.12]),
    };
    let sd = Matrix3::from_diagonal(&Vector3::from(sd));
    let mut correlation = Matrix3::identity();
    (correlation[(0, 2)], correlation[(2, 0)]) = match class {
        VehicleClass::Car | VehicleClass::Motorcycle => (0.0, 0.0),
        VehicleClass::Truck | VehicleClass::Bus => (LENGTH_HEIGHT, LENGTH_HEIGHT),
    };
    Body { class, dims_m: Vector3::from(dims), covariance: sd * correlation * sd }
}

/// Returns the size of a car of this shape.
#[must_use]
pub fn car_body(atlas: &ShapeAtlas, shape: &Shape) -> Body {
    let dims_m = atlas.dims_m(&atlas.clamped(shape));
    Body { class: VehicleClass::Car, dims_m, covariance: Matrix3::zeros() }
}

impl Body {
    /// Returns length, width and height this number of sds above their means, m.
    #[must_use]
    pub fn at_sds_m(&self, sds: f64) -> Vector3<f64> {
        self.dims_m + self.covariance.diagonal().map(f64::sqrt) * sds
    }

    /// Returns the least length, width and height that a fit may give this body, m: one metre, or half of a shorter
    /// side.
    #[must_use]
    pub fn least_m(&self) -> Vector3<f64> {
        self.dims_m.map(|side| if side > LEAST_M { LEAST_M } else { side / 2.0 })
    }

    /// Returns the size for use with other detections of the vehicle: no sd is below 0.3 m.
    #[must_use]
    pub fn at_best(self) -> Self {
        let more = self.covariance.diagonal().map(|variance| (AT_BEST_SD_M.powi(2) - variance).max(0.0));
        Self { covariance: self.covariance + Matrix3::from_diagonal(&more), ..self }
    }
}
