//! How a vehicle's box moves in the picture, by where it was seen.

use nalgebra::Vector2;
use roadplane_base::{bbox_centre, bbox_moved};

/// The last box, and the velocity of its middle.
#[derive(Clone, Debug)]
pub(crate) struct BoxMotion {
    last_px: [f64; 4],
    last_s: f64,
    velocity_px_s: Vector2<f64>,
    /// Time over which the velocity is taken, s.
    memory_s: f64,
    seen: usize,
}

impl BoxMotion {
    pub(crate) fn new(first_px: [f64; 4], time_s: f64, memory_s: f64) -> Self {
        Self { last_px: first_px, last_s: time_s, velocity_px_s: Vector2::zeros(), memory_s, seen: 1 }
    }

    /// It is seen again.
    pub(crate) fn see(&mut self, bbox_px: [f64; 4], time_s: f64) {
        let gap_s = self.unseen_s(time_s);
        if gap_s > 0.0 {
            let velocity = (bbox_centre(&bbox_px) - bbox_centre(&self.last_px)) / gap_s;
            let share = if self.seen < 2 { 1.0 } else { 1.0 - (-gap_s / self.memory_s).exp() };
            self.velocity_px_s += share * (velocity - self.velocity_px_s);
        }
        (self.last_px, self.last_s) = (bbox_px, time_s);
        self.seen += 1;
    }

    /// It stands in this box.
    pub(crate) fn stand(&mut self, bbox_px: [f64; 4], time_s: f64) {
        self.velocity_px_s = Vector2::zeros();
        (self.last_px, self.last_s) = (bbox_px, time_s);
        self.seen += 1;
    }

    /// Box in which it was seen last, px.
    pub(crate) fn last_px(&self) -> &[f64; 4] {
        &self.last_px
    }

    /// For how long it was not seen, s.
    pub(crate) fn unseen_s(&self, time_s: f64) -> f64 {
        time_s - self.last_s
    }

    /// Where the box should be if it goes on, px.
    pub(crate) fn at(&self, time_s: f64) -> [f64; 4] {
        bbox_moved(&self.last_px, &(self.velocity_px_s * self.unseen_s(time_s)))
    }
}
