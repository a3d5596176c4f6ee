//! A reference line along common paths, with distances along it and offsets to its left.

use nalgebra::Vector2;

use super::{
    border::SAME_DIRECTION_COS,
    path::{Path, Point},
};

/// Distance between the nodes of a line, m.
pub(super) const NODE_M: f64 = 2.0;
/// Number of points to each side that a smoothed point depends on: 10 m. Errors of positions are correlated over about
/// this length in the tracks of real clips.
const SMOOTH: usize = 5;

/// A line with nodes at equal distances.
#[derive(Clone, Debug)]
pub(super) struct Reference {
    /// Nodes, m, at least two.
    pub nodes: Vec<Vector2<f64>>,
    /// Unit vector along the line at each node.
    pub forward: Vec<Vector2<f64>>,
}

/// The place of a point relative to a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Distance along the line, m.
    pub along_m: f64,
    /// Offset to the left, m.
    pub left_m: f64,
}

impl Reference {
    /// Returns the line through points; `None` if it is shorter than two nodes.
    pub(super) fn new(points: &[Vector2<f64>]) -> Option<Self> {
        let nodes = resampled(&smoothed(points));
        if nodes.len() < 2 {
            return None;
        }
        let last = nodes.len() - 1;
        let chord = |i: usize| (nodes[(i + 1).min(last)] - nodes[i.saturating_sub(1)]).try_normalize(0.0);
        let forward = (0..nodes.len()).map(chord).collect::<Option<Vec<_>>>()?;
        Some(Self { nodes, forward })
    }

    /// Returns the unit vector to the left at a node.
    pub(super) fn left(&self, node: usize) -> Vector2<f64> {
        Vector2::new(-self.forward[node].y, self.forward[node].x)
    }

    /// Returns the line with each node moved to the left by `left_m`.
    pub(super) fn shifted(&self, left_m: &[f64]) -> Option<Self> {
        let moved = |(i, left_m): (usize, &f64)| self.nodes[i] + self.left(i) * *left_m;
        Self::new(&left_m.iter().enumerate().map(moved).collect::<Vec<_>>())
    }

    /// Returns the place of each point of a path; `None` for points that are beyond the ends or have another direction.
    pub(super) fn places(&self, path: &Path) -> Vec<Option<Place>> {
        let mut near = None;
        path.points.iter().map(|point| self.place(point, &mut near)).collect()
    }

    /// Returns the place of a point. `near` is the node near the point before, if there is one.
    fn place(&self, point: &Point, near: &mut Option<usize>) -> Option<Place> {
        let square = |node: usize| (self.nodes[node] - point.at).norm_squared();
        let nodes = match *near {
            Some(node) => node.saturating_sub(5)..(node + 6).min(self.nodes.len()),
            None => 0..self.nodes.len(),
        };
        let node = nodes.min_by(|&a, &b| square(a).total_cmp(&square(b)))?;
        *near = Some(node);
        let away = point.at - self.nodes[node];
        let ahead = away.dot(&self.forward[node]);
        if ahead.abs() > NODE_M || point.forward.dot(&self.forward[node]) < SAME_DIRECTION_COS {
            *near = None;
            return None;
        }
        Some(Place { along_m: node as f64 * NODE_M + ahead, left_m: away.dot(&self.left(node)) })
    }
}

/// Returns smoothed points: each is the value of a parabola, fitted to its neighbours (Savitzky and Golay 1964). So
/// curves keep their radius. Near the ends, fewer neighbours are used. The ends keep their places.
pub(super) fn smoothed(points: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let fitted = |i: usize| {
        let half = SMOOTH.min(i).min(points.len() - 1 - i);
        let m = half as f64;
        let weight = |k: f64| 3.0 * (3.0 * m * (m + 1.0) - 1.0 - 5.0 * k * k);
        let offsets = (0..=2 * half).map(|j| (j, j as f64 - m));
        let (sum, total) = offsets.fold((Vector2::zeros(), 0.0), |(sum, total), (j, k)| {
            (sum + points[i + j - half] * weight(k), total + weight(k))
        });
        if half < 2 { points[i] } else { sum / total }
    };
    (0..points.len()).map(fitted).collect()
}

/// Returns points at equal distances along a line.
fn resampled(points: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let mut nodes: Vec<Vector2<f64>> = points.first().copied().into_iter().collect();
    let mut left_m = NODE_M;
    for pair in points.windows(2) {
        let length = (pair[1] - pair[0]).norm();
        let mut at = left_m;
        while at <= length {
            nodes.push(pair[0] + (pair[1] - pair[0]) * (at / length));
            at += NODE_M;
        }
        left_m = at - length;
    }
    nodes
}
