//! Gates (lines) and zones (areas) on the ground.

use nalgebra::Vector2;

/// A line on the ground over which vehicles are counted.
#[derive(Clone, Debug, PartialEq)]
pub struct Gate {
    /// Name of the gate.
    pub name: String,
    /// Points of the line in the world frame, m. There are at least two.
    pub line: Vec<Vector2<f64>>,
    /// Sd of the position of the line relative to the vehicles, m. All vehicles share this error. It is 0 for a line in
    /// pixels, because such a line has the same camera error as the vehicles.
    pub shared_sd_m: f64,
}

/// An area on the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// Name of the zone.
    pub name: String,
    /// Corners of the area in the world frame in order, m. There are at least three, and the first is not repeated.
    pub outline: Vec<Vector2<f64>>,
}

/// Side to which a vehicle crosses a gate, as seen from the gate's first point towards its last point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Direction {
    /// From the left side to the right side.
    Forward,
    /// From the right side to the left side.
    Backward,
}

impl Direction {
    /// Both directions.
    pub const ALL: [Self; 2] = [Self::Forward, Self::Backward];

    /// Returns the name of the direction in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Forward => "forward",
            Self::Backward => "backward",
        }
    }
}

impl Zone {
    /// Whether a point is within the area (even–odd rule).
    #[must_use]
    pub fn contains(&self, point: &Vector2<f64>) -> bool {
        let corners = &self.outline;
        let mut inside = false;
        for (i, a) in corners.iter().enumerate() {
            let b = &corners[(i + 1) % corners.len()];
            let spans = (a.y > point.y) != (b.y > point.y);
            if spans && point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y) {
                inside = !inside;
            }
        }
        inside
    }

    /// Returns the area, m².
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        let corners = &self.outline;
        let cross = |i: usize| corners[i].perp(&corners[(i + 1) % corners.len()]);
        ((0..corners.len()).map(cross).sum::<f64>() / 2.0).abs()
    }
}
