//! Computes how well edges agree with a vertical vanishing point.

use std::f64::consts::TAU;

use nalgebra::{Vector2, Vector3};
use roadplane_base::SceneLine;

use crate::CONTRADICTS;
use crate::lens::SHARES;

/// Sd of the lean of masts and walls, rad: half a degree. This is an estimate: masts lean by 0.3–1°, walls by less.
const LEAN_SD: f64 = 0.0087;
/// Range of directions of stray edges, rad; about the range in which edges are searched.
const STRAY: f64 = 1.05;
/// Distance at which two edges belong to one object, 1 sd, as a share of the picture's width; vertically twice that.
const TOGETHER: f64 = 0.025;

/// A node of the search grid: (inverse distance, roll, lens). The inverse distance of the vertical vanishing point is
/// tan(tilt) / focal, 1/px. The roll is in rad. The lens distortion is the share by which the lens draws the half width
/// in (negative) or out.
pub(super) type Node = Vector3<f64>;

/// An edge, in pixels relative to the principal point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    /// Midpoint, px.
    at: Vector2<f64>,
    /// Direction, of unit length.
    along: Vector2<f64>,
}

/// The edges of a picture.
pub(super) struct Field {
    /// The edges as the picture shows them, with its lens distortion.
    edges: Vec<Edge>,
    /// Sd of each edge's direction, including the lean, rad.
    sds: Vec<f64>,
    /// Weight of each edge; an object with many edges counts as one.
    weights: Vec<f64>,
    /// Half of the picture's width, px.
    pub(super) half_width: f64,
}

impl Field {
    /// Builds the field from lines in pixels. `width` is the picture's width, px.
    pub(super) fn new(lines: &[SceneLine], principal_point_px: &Vector2<f64>, width: f64) -> Self {
        let edge = |line: &SceneLine| Edge {
            at: line.middle_px() - principal_point_px,
            along: line.along_px() / line.along_px().norm(),
        };
        let edges: Vec<Edge> = lines.iter().map(edge).collect();
        let near = |a: &Edge, b: &Edge| {
            let apart = (a.at - b.at).component_div(&Vector2::new(1.0, 2.0)) / (TOGETHER * width);
            (-0.5 * apart.norm_squared()).exp()
        };
        let length = |i: usize| lines[i].along_px().norm();
        // n edges that share a lean have the information 1 / (lean² + own² / n). The sum n / (lean² + own²) would claim
        // more.
        let weight = |i: usize| {
            let beside: f64 = (0..edges.len()).map(|k| near(&edges[i], &edges[k]) * length(k)).sum();
            let (count, own) = (beside / length(i), (lines[i].sd_rad / LEAN_SD).powi(2));
            (1.0 + own) / (count + own)
        };
        Self {
            sds: lines.iter().map(|line| line.sd_rad.hypot(LEAN_SD)).collect(),
            weights: (0..edges.len()).map(weight).collect(),
            half_width: 0.5 * width,
            edges,
        }
    }

    /// Returns the edges with the distortion `lens` removed, to first order: `p (1 − lens |p|² / half width²)`.
    pub(super) fn undistorted(&self, lens: f64) -> Vec<Edge> {
        let distortion = lens / (self.half_width * self.half_width);
        let straight = |edge: &Edge| {
            let scale = 1.0 - distortion * edge.at.norm_squared();
            let along = edge.along * scale - 2.0 * distortion * edge.at * edge.at.dot(&edge.along);
            Edge { at: edge.at * scale, along: along / along.norm() }
        };
        self.edges.iter().map(straight).collect()
    }

    /// Returns the likelihood ratio of an edge between vertical and stray; `None` where the misfit is so large that it
    /// is stray.
    fn odds(&self, i: usize, edge: &Edge, node: &Node) -> Option<f64> {
        let (sin, cos) = node.y.sin_cos();
        let upright = Vector2::new(sin, -cos) + node.x * edge.at;
        // The sine is close to the angle wherever the edge is not stray.
        let square = edge.along.perp(&upright).powi(2) / (upright.norm_squared() * self.sds[i] * self.sds[i]);
        (square < CONTRADICTS).then(|| (-0.5 * square).exp() * STRAY / (self.sds[i] * TAU.sqrt()))
    }

    /// Returns the log likelihood ratio of undistorted edges to stray edges at a node, averaged over the share of
    /// verticals.
    pub(super) fn log_ratio(&self, seen: &[Edge], node: &Node) -> f64 {
        let mut logs = SHARES.map(|share| self.weights.iter().sum::<f64>() * (1.0 - share).ln());
        for (i, edge) in seen.iter().enumerate() {
            let Some(odds) = self.odds(i, edge, node) else { continue };
            for (log, share) in logs.iter_mut().zip(SHARES) {
                *log += self.weights[i] * (1.0 + share / (1.0 - share) * odds).ln();
            }
        }
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        most + (logs.iter().map(|log| (log - most).exp()).sum::<f64>() / SHARES.len() as f64).ln()
    }

    /// Returns the probability that each edge is vertical at a node, with the most probable share of vertical edges
    /// there.
    pub(super) fn probabilities(&self, node: &Node) -> Vec<f64> {
        let seen = self.undistorted(node.z);
        let odds: Vec<f64> =
            seen.iter().enumerate().map(|(i, edge)| self.odds(i, edge, node).unwrap_or(0.0)).collect();
        let probabilities =
            |share: f64| odds.iter().map(|odds| share * odds / (1.0 - share + share * odds)).collect();
        let mut share = 0.5;
        let weight: f64 = self.weights.iter().sum();
        for _ in 0..20 {
            let here: Vec<f64> = probabilities(share);
            let upright: f64 = here.iter().zip(&self.weights).map(|(t, w)| t * w).sum();
            share = (upright / weight).clamp(0.02, 0.98);
        }
        probabilities(share)
    }
}
