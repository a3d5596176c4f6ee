//! The wheels of a vehicle: their positions, and the triangles of each wheel. The triangles are relative to the hub, so
//! a simulator can turn the wheel.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use roadplane_base::KEYPOINTS;
use serde::Serialize;

use crate::mesh::{Part, Triangle, point};

/// Width of a tyre, m.
pub(crate) const TYRE_M: f64 = 0.2;
/// Number of corners of a wheel's outline. A spoke and the gap beside it take up four sides of the outline.
const CORNERS: usize = 20;
/// Radius of the rim divided by the radius of the wheel.
const RIM: f64 = 0.66;

/// Positions and size of the wheels of a vehicle.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Wheels {
    /// Distance from the vehicle's origin to each axle, m.
    pub half_wheelbase_m: f64,
    /// Distance between the outer faces of the left and right wheels, m.
    pub track_m: f64,
    /// Diameter of a wheel, m.
    pub diameter_m: f64,
}

impl Wheels {
    /// Computes the wheels of a car from its keypoints (car frame, m).
    #[must_use]
    pub fn of(points: &[Vector3<f64>; KEYPOINTS]) -> Self {
        let [front, rear] = [point(points, "left_wheel_front"), point(points, "left_wheel_rear")];
        Self { half_wheelbase_m: (front.x - rear.x) / 2.0, track_m: 2.0 * front.y, diameter_m: 2.0 * front.z }
    }

    /// Returns the name and the centre (car frame, m) of each wheel.
    #[must_use]
    pub fn hubs(&self) -> [(&'static str, Point3<f64>); 4] {
        let hub = |ahead: f64, side: f64| {
            let y = side * (self.track_m - TYRE_M) / 2.0;
            Point3::new(ahead * self.half_wheelbase_m, y, self.diameter_m / 2.0)
        };
        [
            ("wheel_fl", hub(1.0, 1.0)),
            ("wheel_fr", hub(1.0, -1.0)),
            ("wheel_rl", hub(-1.0, 1.0)),
            ("wheel_rr", hub(-1.0, -1.0)),
        ]
    }

    /// Returns the triangles of a wheel relative to its centre: a tyre, and a rim on the outer side. `outwards` is 1
    /// for a left wheel and −1 for a right wheel.
    ///
    /// The rim has spokes, which make the rotation of the wheel visible.
    #[must_use]
    pub fn triangles(&self, outwards: f64) -> Vec<Triangle> {
        let radius = self.diameter_m / 2.0;
        let corner = |i: usize, share: f64, y: f64| {
            let (sin, cos) = (TAU * (i % CORNERS) as f64 / CORNERS as f64).sin_cos();
            Point3::new(share * radius * cos, outwards * y, share * radius * sin)
        };
        let (outer, inner) = (TYRE_M / 2.0, -TYRE_M / 2.0);
        let mut triangles = Vec::new();
        for i in 0..CORNERS {
            let [a, b] = [i, i + 1].map(|i| corner(i, RIM, outer));
            let [c, d] = [i + 1, i].map(|i| corner(i, 1.0, outer));
            let [e, f] = [i + 1, i].map(|i| corner(i, 1.0, inner));
            let face = if i % 4 < 2 { Part::Rim } else { Part::Rubber };
            triangles.push((face, [Point3::new(0.0, outwards * outer, 0.0), b, a]));
            let tyre =
                [[a, b, c], [a, c, d], [d, c, e], [d, e, f], [Point3::new(0.0, outwards * inner, 0.0), f, e]];
            triangles.extend(tyre.map(|triangle| (Part::Rubber, triangle)));
        }
        if outwards < 0.0 {
            triangles.iter_mut().for_each(|(_, corners)| corners.swap(1, 2));
        }
        triangles
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{Shape, ShapeAtlas};

    #[test]
    fn wheels_are_closed_and_touch_the_ground_under_the_car() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let wheels = Wheels::of(&atlas.keypoints_in_car(&Shape::zeros()));
        for (name, hub) in wheels.hubs() {
            let triangles = wheels.triangles(hub.y.signum());
            let corners = || triangles.iter().flat_map(|(_, corners)| corners);
            let low = corners().map(|p| p.z).fold(f64::MAX, f64::min);
            assert!((hub.z + low).abs() < 1e-9, "{name}");
            let out = corners().map(|p| (hub.y + p.y).abs()).fold(0.0, f64::max);
            assert!((2.0 * out - wheels.track_m).abs() < 1e-9, "{name}");
            // If all faces point outwards, the volume equals that of a prism with as many sides.
            let volume: f64 =
                triangles.iter().map(|(_, [a, b, c])| a.coords.dot(&b.coords.cross(&c.coords)) / 6.0).sum();
            let base =
                CORNERS as f64 / 2.0 * (wheels.diameter_m / 2.0).powi(2) * (TAU / CORNERS as f64).sin();
            assert!((volume - base * TYRE_M).abs() < 1e-9, "{name}: {volume}");
        }
    }
}
