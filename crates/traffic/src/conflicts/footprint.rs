//! The rectangle that a vehicle covers on the ground, and when two such rectangles touch.

use nalgebra::Vector2;

/// The rectangle that a vehicle covers on the ground.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footprint {
    /// Centre, m.
    pub centre: Vector2<f64>,
    /// Unit vector along the heading.
    pub forward: Vector2<f64>,
    /// Half the length and half the width, m.
    pub half_m: [f64; 2],
}

impl Footprint {
    /// Returns the unit vector to the left of the heading.
    pub fn left(&self) -> Vector2<f64> {
        Vector2::new(-self.forward.y, self.forward.x)
    }

    /// Returns half the size of the rectangle along a unit vector, m.
    fn reach_m(&self, axis: &Vector2<f64>) -> f64 {
        self.half_m[0] * self.forward.dot(axis).abs() + self.half_m[1] * self.left().dot(axis).abs()
    }

    /// Returns the part of a motion in which two rectangles touch: the first and the last share of the motion, between 0
    /// and 1. The motions (m) are straight, uniform and without rotation. `None` if the rectangles do not touch.
    ///
    /// Two rectangles touch exactly if their shadows on all four edge directions overlap (separating axes).
    pub fn touch(
        &self,
        motion: &Vector2<f64>,
        other: &Self,
        other_motion: &Vector2<f64>,
    ) -> Option<[f64; 2]> {
        let apart = other.centre - self.centre;
        let approach = other_motion - motion;
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for axis in [other.left(), self.left(), other.forward, self.forward] {
            let reach = self.reach_m(&axis) + other.reach_m(&axis);
            let (start, change) = (apart.dot(&axis), approach.dot(&axis));
            if change.abs() < 1e-12 {
                if start.abs() > reach {
                    return None;
                }
                continue;
            }
            let (a, b) = ((-reach - start) / change, (reach - start) / change);
            from = from.max(a.min(b));
            to = to.min(a.max(b));
            if from > to {
                return None;
            }
        }
        Some([from, to])
    }

    /// Returns the edge direction that separates two rectangles best, and their distance along it, m. The direction
    /// points from this rectangle to the other one. A negative distance is the depth of an overlap.
    pub fn separation(&self, other: &Self) -> (Vector2<f64>, f64) {
        let apart = other.centre - self.centre;
        let mut best = (self.forward, f64::NEG_INFINITY);
        for axis in [other.forward, self.forward, other.left(), self.left()] {
            let along = apart.dot(&axis);
            let gap = along.abs() - self.reach_m(&axis) - other.reach_m(&axis);
            // The margin makes the choice among equal distances independent of rounding.
            if gap > best.1 + 1e-9 {
                best = (if along < 0.0 { -axis } else { axis }, gap);
            }
        }
        best
    }

    /// Returns the middle between the points of two rectangles that are nearest to the other's centre, m.
    pub fn contact(&self, other: &Self) -> Vector2<f64> {
        (self.nearest(&other.centre) + other.nearest(&self.centre)) / 2.0
    }

    fn nearest(&self, point: &Vector2<f64>) -> Vector2<f64> {
        let apart = point - self.centre;
        let [length, width] = self.half_m;
        let along = apart.dot(&self.forward).clamp(-length, length);
        let across = apart.dot(&self.left()).clamp(-width, width);
        self.centre + self.forward * along + self.left() * across
    }
}

/// Returns the angle between two headings, 0 to π, rad.
pub(super) fn angle_rad(a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    a.perp(b).atan2(a.dot(b)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(x: f64, y: f64, heading_rad: f64) -> Footprint {
        let (sin, cos) = heading_rad.sin_cos();
        Footprint { centre: Vector2::new(x, y), forward: Vector2::new(cos, sin), half_m: [2.0, 1.0] }
    }

    #[test]
    fn a_car_that_crosses_another_one() {
        let (moving, still) = (car(-10.0, 0.0, 0.0), car(0.0, 0.5, std::f64::consts::FRAC_PI_2));
        let touch = moving.touch(&Vector2::new(20.0, 0.0), &still, &Vector2::zeros()).unwrap();
        // The front at x = −8 reaches −1 after 7 m, the rear at −12 leaves +1 after 13 m.
        assert!((touch[0] - 7.0 / 20.0).abs() < 1e-12 && (touch[1] - 13.0 / 20.0).abs() < 1e-12, "{touch:?}");
        assert!(moving.touch(&Vector2::new(0.0, 20.0), &still, &Vector2::zeros()).is_none());
        assert!(moving.touch(&Vector2::new(6.9, 0.0), &still, &Vector2::zeros()).is_none());
    }

    #[test]
    fn separation_and_contact_of_two_cars_in_a_lane() {
        let (ahead, behind) = (car(10.0, 0.2, 0.0), car(0.0, 0.0, 0.0));
        let (axis, gap_m) = behind.separation(&ahead);
        assert!((gap_m - 6.0).abs() < 1e-12 && (axis - Vector2::x()).norm() < 1e-12, "{axis} {gap_m}");
        assert!((behind.contact(&ahead) - Vector2::new(5.0, 0.1)).norm() < 1e-12);
        assert!((angle_rad(&Vector2::x(), &Vector2::new(-1.0, -1e-9)) - std::f64::consts::PI).abs() < 1e-6);
    }
}
