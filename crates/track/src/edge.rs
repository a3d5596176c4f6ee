//! What an edge of a box says of the body in it: it is the body's own, or something hides the body there.
//!
//! Density of the edge, g px inside the body's own (negative: outside), at an sd of σ:
//!
//! ```text
//! (1 − h) N(g; 0, σ) + h (g < 0 ? exp(−g² / 2 σ²) : 1) / S + w / S
//! ```
//!
//! h: the share of edges at which something is in front; what is hidden may be as much as all of the body, S px. w: boxes of something
//! else. Solved by reweighting: an edge counts by how likely it is the body's own (EM: Dempster, Laird and Rubin 1977).

use std::f64::consts::TAU;

/// Edges at which masts, trees and whatever is no vehicle hide something.
const HIDDEN: f64 = 0.05;
/// The same where another vehicle begins: it may stand behind.
const HIDDEN_BY_VEHICLE: f64 = 0.7;
/// Boxes of something else.
const WRONG: f64 = 0.01;

/// An edge of a box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    /// Where it is, px.
    pub seen_px: f64,
    pub sd_px: f64,
    /// How likely the body goes on there.
    pub hidden: f64,
    /// S, px.
    pub reach_px: f64,
    /// So many looks it counts as.
    pub looks: f64,
}

impl Edge {
    /// How likely a body goes on beyond an edge.
    pub(crate) fn hidden(is_cut: bool, by_vehicle: bool) -> f64 {
        match (is_cut, by_vehicle) {
            (true, _) => 1.0,
            (_, true) => HIDDEN_BY_VEHICLE,
            _ => HIDDEN,
        }
    }

    /// Whether something that is known is before the body there, or the picture ends.
    pub(crate) fn is_hidden(&self) -> bool {
        self.hidden > HIDDEN
    }

    /// Whether the edge, `inside` the body's own by so many sds, is rather the body's own than not.
    pub(crate) fn is_own(&self, inside: f64) -> bool {
        self.cost_and_weight(inside).1 > 0.5 * self.looks
    }

    /// Negative log density at an edge that lies `inside` the body's own by so many sds, up to a constant; and what share of it is of
    /// terms that pull.
    pub(crate) fn cost_and_weight(&self, inside: f64) -> (f64, f64) {
        let near = (-0.5 * inside * inside).exp();
        let own = (1.0 - self.hidden) / TAU.sqrt() * near;
        let share = self.sd_px / self.reach_px;
        let hidden = self.hidden * share;
        let (pulls, rest) = if inside < 0.0 { (own + hidden * near, 0.0) } else { (own, hidden) };
        let all = pulls + rest + WRONG * share;
        (-self.looks * all.ln(), self.looks * pulls / all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge(hidden: f64) -> Edge {
        Edge { seen_px: 0.0, sd_px: 2.0, hidden, reach_px: 100.0, looks: 1.0 }
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
