//! How well edges agree with a vertical.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use roadplane_base::SceneLine;

/// sd of how far masts and walls are off the vertical, rad: half a degree (estimate; masts lean by 0.3–1°, walls less).
const LEAN_SD: f64 = 0.0087;
/// Edges that are not vertical point anywhere within this, rad: about what edges are looked for in.
const STRAY: f64 = 1.05;
/// Shares of vertical edges that are weighed, evenly.
const SHARES: [f64; 4] = [0.06, 0.2, 0.5, 0.8];
/// Edges within this share of the picture's width from each other (1 sd, upright twice that) are taken for one thing's.
const TOGETHER: f64 = 0.025;
/// Misfits beyond this square in sds weigh nothing beside a stray edge.
const FAR: f64 = 30.0;

/// A place in the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    /// tan(tilt) / focal, 1/px.
    pub bend: f64,
    /// rad.
    pub roll: f64,
    /// Share by which the lens draws the half width in (negative) or out.
    pub lens: f64,
}

/// An edge, pixels from the principal point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    at: Vector2<f64>,
    /// Unit length.
    along: Vector2<f64>,
}

/// The edges of a picture.
pub(super) struct Field {
    edges: Vec<Edge>,
    /// sd of each one's direction, lean counted, rad.
    sds: Vec<f64>,
    /// How much each counts: a thing with many edges counts as one.
    weights: Vec<f64>,
    half_width: f64,
}

impl Field {
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
        // n edges that share a lean say 1 / (lean² + own² / n) of it, n times 1 / (lean² + own²) would claim more.
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

    pub(super) fn half_width(&self) -> f64 {
        self.half_width
    }

    /// The edges as a lens that bends no lines would show them, to first order: `p (1 − lens |p|² / half width²)`.
    pub(super) fn straightened(&self, lens: f64) -> Vec<Edge> {
        let bent = lens / (self.half_width * self.half_width);
        let straight = |edge: &Edge| {
            let scale = 1.0 - bent * edge.at.norm_squared();
            let along = edge.along * scale - 2.0 * bent * edge.at * edge.at.dot(&edge.along);
            Edge { at: edge.at * scale, along: along / along.norm() }
        };
        self.edges.iter().map(straight).collect()
    }

    /// Squared misfit of an edge in sds, and how much likelier it is than a stray one were it vertical.
    fn odds(&self, i: usize, edge: &Edge, node: &Node) -> Option<f64> {
        let (sin, cos) = node.roll.sin_cos();
        let upright = Vector2::new(sin, -cos) + node.bend * edge.at;
        // The sine will do: where it is not the angle, the edge is a stray one.
        let square = edge.along.perp(&upright).powi(2) / (upright.norm_squared() * self.sds[i] * self.sds[i]);
        (square < FAR).then(|| (-0.5 * square).exp() * STRAY / (self.sds[i] * TAU.sqrt()))
    }

    /// Log likelihood of straightened edges at a node, over that of stray ones, whatever the share of vertical edges.
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

    /// Probability that each edge is vertical, at a node, with the share of vertical edges that is likeliest there.
    pub(super) fn trust(&self, node: &Node) -> Vec<f64> {
        let seen = self.straightened(node.lens);
        let odds: Vec<f64> =
            seen.iter().enumerate().map(|(i, edge)| self.odds(i, edge, node).unwrap_or(0.0)).collect();
        let trusts =
            |share: f64| odds.iter().map(|odds| share * odds / (1.0 - share + share * odds)).collect();
        let mut share = 0.5;
        let weight: f64 = self.weights.iter().sum();
        for _ in 0..20 {
            let trusts: Vec<f64> = trusts(share);
            let upright: f64 = trusts.iter().zip(&self.weights).map(|(t, w)| t * w).sum();
            share = (upright / weight).clamp(0.02, 0.98);
        }
        trusts(share)
    }
}
