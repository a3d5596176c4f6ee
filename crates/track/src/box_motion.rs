//! Extrapolates the box of a vehicle in the picture from its detections.

use nalgebra::Vector2;
use roadplane_base::{bbox_centre, bbox_moved};

/// Time constant of the velocity's average, s.
const MEMORY_S: f64 = 0.25;
/// Time without a detection after which a vehicle's motion is unknown, s. A driving vehicle is then no longer followed:
/// only linking (`link.rs`) can find it again. So a longer gap is a join.
pub(crate) const COAST_S: f64 = 0.4;

/// The last box of a vehicle, and the velocity of the box's centre.
#[derive(Clone, Debug)]
pub(crate) struct BoxMotion {
    /// Box of the last detection (left, top, right, bottom), px.
    pub last_px: [f64; 4],
    last_s: f64,
    /// Velocity of the box's centre, px/s.
    velocity_px_s: Vector2<f64>,
    seen: usize,
}

impl BoxMotion {
    /// Starts with the first box (px) at a time (s).
    pub(crate) fn new(first_px: [f64; 4], time_s: f64) -> Self {
        Self { last_px: first_px, last_s: time_s, velocity_px_s: Vector2::zeros(), seen: 1 }
    }

    /// Adds a detection: its box (px) and its time (s).
    pub(crate) fn see(&mut self, bbox_px: [f64; 4], time_s: f64) {
        let gap_s = self.unseen_s(time_s);
        if gap_s > 0.0 {
            let velocity = (bbox_centre(&bbox_px) - bbox_centre(&self.last_px)) / gap_s;
            let share = if self.seen < 2 { 1.0 } else { 1.0 - (-gap_s / MEMORY_S).exp() };
            self.velocity_px_s += share * (velocity - self.velocity_px_s);
        }
        (self.last_px, self.last_s) = (bbox_px, time_s);
        self.seen += 1;
    }

    /// Adds a detection of a stationary vehicle in this box (px), at a time (s).
    pub(crate) fn rest(&mut self, bbox_px: [f64; 4], time_s: f64) {
        self.velocity_px_s = Vector2::zeros();
        (self.last_px, self.last_s) = (bbox_px, time_s);
        self.seen += 1;
    }

    /// Returns the time since the last detection, s.
    pub(crate) fn unseen_s(&self, time_s: f64) -> f64 {
        time_s - self.last_s
    }

    /// Returns the expected box at a time (s) if the motion continues, px.
    pub(crate) fn at(&self, time_s: f64) -> [f64; 4] {
        bbox_moved(&self.last_px, &(self.velocity_px_s * self.unseen_s(time_s)))
    }
}
