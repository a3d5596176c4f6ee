//! How large vehicles are.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::{Shape, ShapeAtlas, VehicleClass};

/// How well a track's size is known to other looks at it, m.
const AT_BEST_SD_M: f64 = 0.3;

/// Correlation of length and height: vans are short and low, lorries and coaches long and high.
const LENGTH_HEIGHT: f64 = 0.5;

/// A vehicle's size as far as it is known.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Length, width, height, m.
    pub dims_m: Vector3<f64>,
    /// Their covariance.
    pub covariance: Matrix3<f64>,
}

/// How long, wide and high vehicles of a class are (types of road vehicles, EU; width without mirrors).
#[must_use]
pub fn body_of(class: VehicleClass) -> Body {
    let (dims, sd) = match class {
        VehicleClass::Car => ([4.5, 1.8, 1.55], [0.4, 0.1, 0.15]),
        VehicleClass::Truck => ([7.5, 2.4, 3.0], [2.5, 0.2, 0.6]),
        VehicleClass::Bus => ([11.0, 2.5, 3.1], [2.0, 0.1, 0.25]),
    };
    let sd = Matrix3::from_diagonal(&Vector3::from(sd));
    let mut correlation = Matrix3::identity();
    (correlation[(0, 2)], correlation[(2, 0)]) = match class {
        VehicleClass::Car => (0.0, 0.0),
        VehicleClass::Truck | VehicleClass::Bus => (LENGTH_HEIGHT, LENGTH_HEIGHT),
    };
    Body { class, dims_m: Vector3::from(dims), covariance: sd * correlation * sd }
}

/// How large a car of this shape is.
#[must_use]
pub fn car_body(atlas: &ShapeAtlas, shape: &Shape) -> Body {
    let dims_m = atlas.dims_m(&atlas.clamped(shape));
    Body { class: VehicleClass::Car, dims_m, covariance: Matrix3::zeros() }
}

impl Body {
    /// As other looks at the same vehicle may take it: no track knows sizes better.
    #[must_use]
    pub fn at_best(self) -> Self {
        let more = self.covariance.diagonal().map(|variance| (AT_BEST_SD_M.powi(2) - variance).max(0.0));
        Self { covariance: self.covariance + Matrix3::from_diagonal(&more), ..self }
    }
}
