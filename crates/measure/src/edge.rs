//! A model of one edge of a box: the edge is the body's own, or something hides the body there.
//!
//! The density of an edge that lies g px inside the body's own edge (negative: outside), with sd σ, is
//!
//! ```text
//! (1 − h) N(g; 0, σ) + h (g < 0 ? exp(−g² / 2 σ²) : 1) / S + w / S
//! ```
//!
//! Here h is the share of edges at which something is in front. The hidden part may be as large as all of the body, S
//! px. w is the share of boxes of other objects. The model is solved by reweighting: the weight of an edge is the
//! probability that it is the body's own (EM: Dempster, Laird and Rubin 1977).

use std::f64::consts::TAU;

/// Share of edges at which masts, trees and other objects that are no vehicles hide the body.
const HIDDEN: f64 = 0.05;
/// Share of edges at which another vehicle hides the body, among edges where one begins. That vehicle may also be
/// behind the body.
const HIDDEN_BY_VEHICLE: f64 = 0.7;
/// Share of edges that belong to boxes of other objects.
const WRONG: f64 = 0.01;

/// Constant part of an edge's sd from one observation to the next, px.
pub(crate) const EDGE_SD_PX: f64 = 1.0;
/// Part of an edge's sd from one observation to the next that is proportional to the box's shorter side, without unit.
pub(crate) const EDGE_SD_SHARE: f64 = 0.03;
/// Sd of an edge's offset that all observations share, as a share of the box's shorter side. It is there because bodies
/// are no boxes.
pub const OUTLINE_SD: f64 = 0.04;
/// Largest hidden part of a body, in shorter sides of the visible part.
pub const REACH: f64 = 2.0;
/// Sign of the outward direction at a box's left, top, right and bottom edge.
pub const OUTWARD: [f64; 4] = [-1.0, -1.0, 1.0, 1.0];

/// Returns the sd of an edge from one observation to the next, for a box with this shorter side, px.
#[must_use]
pub fn edge_sd_px(side_px: f64) -> f64 {
    EDGE_SD_PX + EDGE_SD_SHARE * side_px
}

/// An edge of a box.
#[derive(Clone, Copy, Debug)]
pub struct Edge {
    /// Position of the edge in the picture, px.
    pub seen_px: f64,
    /// Sd of the edge's position, px.
    pub sd_px: f64,
    /// Probability that the body continues beyond the edge, 0–1.
    pub hidden: f64,
    /// Largest hidden part S, px.
    pub reach_px: f64,
    /// Number of independent observations that the edge counts as.
    pub independent: f64,
}

impl Edge {
    /// Returns the probability that a body continues beyond an edge, 0–1.
    pub fn hidden(is_cut: bool, by_vehicle: bool) -> f64 {
        match (is_cut, by_vehicle) {
            (true, _) => 1.0,
            (_, true) => HIDDEN_BY_VEHICLE,
            _ => HIDDEN,
        }
    }

    /// Whether another vehicle may hide the body there, or the picture ends there.
    pub fn is_hidden(&self) -> bool {
        self.hidden > HIDDEN
    }

    /// Whether the edge is more probably the body's own than not. `inside` is the distance by which it lies inside the
    /// body's own edge, in sds.
    pub fn is_own(&self, inside: f64) -> bool {
        self.cost_and_weight(inside).1 > 0.5 * self.independent
    }

    /// Returns the negative log density of an edge that lies `inside` the body's own by so many sds, up to a constant.
    /// The second number is its weight: the share of the density from terms that pull the edges together.
    pub fn cost_and_weight(&self, inside: f64) -> (f64, f64) {
        let near = (-0.5 * inside * inside).exp();
        let own = (1.0 - self.hidden) / TAU.sqrt() * near;
        let share = self.sd_px / self.reach_px;
        let hidden = self.hidden * share;
        let (pulls, rest) = if inside < 0.0 { (own + hidden * near, 0.0) } else { (own, hidden) };
        let all = pulls + rest + WRONG * share;
        (-self.independent * all.ln(), self.independent * pulls / all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns an edge at 0 px with an sd of 2 px that is hidden with this probability.
    fn edge(hidden: f64) -> Edge {
        Edge { seen_px: 0.0, sd_px: 2.0, hidden, reach_px: 100.0, independent: 1.0 }
    }

    #[test]
    fn the_weight_is_the_slope_of_the_cost() {
        for hidden in [0.05, 0.7, 1.0] {
            for inside in [-6.0, -2.0, -0.5, 0.5, 2.0, 6.0] {
                let cost = |at: f64| edge(hidden).cost_and_weight(at).0;
                let slope = (cost(inside + 1e-6) - cost(inside - 1e-6)) / 2e-6;
                let weight = edge(hidden).cost_and_weight(inside).1;
                assert!((slope - weight * inside).abs() < 1e-5, "{hidden} {inside}");
            }
        }
    }

    #[test]
    fn a_body_may_be_hidden_and_is_seldom_smaller_than_its_box() {
        let weight = |hidden, inside| edge(hidden).cost_and_weight(inside).1;
        assert!(weight(0.05, 0.0) > 0.99 && weight(0.05, -3.0) > 0.9 && weight(0.05, 5.0) < 0.01);
        assert!(weight(1.0, -1.0) > 0.8 && weight(1.0, 1.0) == 0.0);
    }
}
