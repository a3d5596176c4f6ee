//! The border of the traffic: the places where most vehicles come into view or leave it.
//!
//! A vehicle that is lost or hidden on its way also begins or ends there. But most vehicles that pass such a place in
//! the same direction were followed before it and behind it.

use std::collections::HashMap;

use nalgebra::Vector2;

use super::path::{Path, Point};

/// Cosine of the largest angle between two vehicles in one direction: 30°.
pub(super) const SAME_DIRECTION_COS: f64 = 0.866;
/// Largest distance across the road between vehicles in one lane, m: half a lane (3.5 m, RAA 2008 and Green Book 2018).
pub(crate) const HALF_LANE_M: f64 = 1.75;
/// Length over which a vehicle must be followed beyond a place to show that the place is no border, m. The first and
/// last places in view of short and long vehicles differ by up to the length of a bus (12 m).
const BEYOND_M: f64 = 12.0;
/// Side of a square of the search index, m.
const CELL_M: f64 = 5.0;

/// A place where a vehicle comes into view while it drives, or leaves it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event {
    /// Index of the path.
    pub path: usize,
    /// Position, m.
    pub at: Vector2<f64>,
    /// Unit vector along the vehicle's road, out of the scene.
    pub outward: Vector2<f64>,
    /// Whether the vehicle comes into view.
    pub enters: bool,
}

/// Returns the events at the border of the traffic, in the order of paths.
pub(super) fn events(paths: &[Path]) -> Vec<Event> {
    let index = Index::new(paths);
    let mut events = Vec::new();
    for (i, path) in paths.iter().enumerate() {
        for (wanted, enters) in [(path.begins, true), (path.ends, false)] {
            if wanted && !index.is_inside(paths, i, enters) {
                let (point, outward) = end(path, enters);
                events.push(Event { path: i, at: point.at, outward, enters });
            }
        }
    }
    events
}

/// Returns the first or last point of a path, and the direction out of the scene: over the outermost 10 m.
fn end(path: &Path, first: bool) -> (&Point, Vector2<f64>) {
    let points = &path.points;
    let length = path.length_m();
    let (outer, inner) = if first {
        (0, points.partition_point(|point| point.along_m < 10.0).min(points.len() - 1))
    } else {
        (
            points.len() - 1,
            points.partition_point(|point| point.along_m < length - 10.0).min(points.len() - 2),
        )
    };
    let outward = (points[outer].at - points[inner].at).try_normalize(0.0).unwrap_or(points[outer].forward);
    (&points[outer], outward)
}

/// The points of all paths by place.
struct Index {
    cells: HashMap<(i64, i64), Vec<(u32, u32)>>,
}

impl Index {
    fn new(paths: &[Path]) -> Self {
        let mut cells: HashMap<_, Vec<_>> = HashMap::new();
        for (i, path) in paths.iter().enumerate() {
            for (k, point) in path.points.iter().enumerate() {
                cells.entry(cell(&point.at)).or_default().push((i as u32, k as u32));
            }
        }
        Self { cells }
    }

    /// Whether most vehicles that pass an end of a path in the same direction were followed beyond it.
    fn is_inside(&self, paths: &[Path], path: usize, first: bool) -> bool {
        let points = &paths[path].points;
        let here = if first { &points[0] } else { &points[points.len() - 1] };
        let side = Vector2::new(-here.forward.y, here.forward.x);
        let sd = here.state.own_variance_along(&side).sqrt();
        let (x, y) = cell(&here.at);
        let near = (x - 1..=x + 1)
            .flat_map(|x| (y - 1..=y + 1).map(move |y| (x, y)))
            .filter_map(|cell| self.cells.get(&cell))
            .flatten();
        let mut passing: Vec<(u32, bool)> = Vec::new(); // and whether the vehicle begins or ends here, too
        for &(i, k) in near {
            let other = &paths[i as usize];
            let point = &other.points[k as usize];
            let away = point.at - here.at;
            let reach = HALF_LANE_M + (sd.powi(2) + point.state.own_variance_along(&side)).sqrt();
            if i as usize == path
                || away.dot(&here.forward).abs() > CELL_M / 2.0
                || away.dot(&side).abs() > reach
                || point.forward.dot(&here.forward) < SAME_DIRECTION_COS
            {
                continue;
            }
            let beyond = if first { point.along_m } else { other.length_m() - point.along_m } > BEYOND_M;
            // Vehicles that were there when the clip began, or stopped here, show nothing.
            if beyond || if first { other.begins } else { other.ends } {
                passing.push((i, !beyond));
            }
        }
        passing.sort_unstable();
        passing.dedup_by_key(|entry| entry.0);
        2 * passing.iter().filter(|entry| !entry.1).count() > passing.len()
    }
}

fn cell(at: &Vector2<f64>) -> (i64, i64) {
    ((at.x / CELL_M).floor() as i64, (at.y / CELL_M).floor() as i64)
}
