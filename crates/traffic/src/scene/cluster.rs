//! Groups of border events: one for each road.

use nalgebra::Vector2;

use super::{
    border::{Event, SAME_DIRECTION_COS},
    path::Path,
};

/// Widest strip without traffic within one road, m: a lane without vehicles and a median, or two lanes.
pub(super) const LINK_ACROSS_M: f64 = 10.0;
/// Longest distance along the road between neighbouring events, m.
const LINK_ALONG_M: f64 = 30.0;
/// Fewest vehicles of an arm, and of a flow: two may be one wrong track that was cut.
pub(super) const FEWEST: usize = 3;

/// Returns groups of events, by the density-based method DBSCAN (Ester, Kriegel, Sander and Xu 1996). An event with
/// `FEWEST` events within reach joins all of them to its group. It counts itself. Events in no group are left out.
pub(super) fn groups(paths: &[Path], events: &[Event]) -> Vec<Vec<Event>> {
    let near = |a: usize| (0..events.len()).filter(move |&b| linked(paths, &events[a], &events[b]));
    let mut group_of: Vec<Option<usize>> = vec![None; events.len()];
    let mut groups = 0;
    for start in 0..events.len() {
        if group_of[start].is_some() || near(start).count() < FEWEST {
            continue;
        }
        let mut open = vec![start];
        group_of[start] = Some(groups);
        while let Some(a) = open.pop() {
            let found: Vec<usize> = near(a).collect();
            if found.len() < FEWEST {
                continue;
            }
            for b in found {
                if group_of[b].is_none() {
                    group_of[b] = Some(groups);
                    open.push(b);
                }
            }
        }
        groups += 1;
    }
    let members = |group| {
        events.iter().zip(&group_of).filter(move |(_, of)| **of == Some(group)).map(|(event, _)| *event)
    };
    (0..groups).map(|group| members(group).collect()).collect()
}

/// Whether two events are on the same road. Their sds across the road widen the reach.
fn linked(paths: &[Path], a: &Event, b: &Event) -> bool {
    if a.outward.dot(&b.outward) < SAME_DIRECTION_COS {
        return false;
    }
    let Some(axis) = (a.outward + b.outward).try_normalize(0.0) else { return false };
    let side = Vector2::new(-axis.y, axis.x);
    let variance = |event: &Event| {
        let points = &paths[event.path].points;
        points[if event.enters { 0 } else { points.len() - 1 }].state.own_variance_along(&side)
    };
    let away = b.at - a.at;
    let across_m = LINK_ACROSS_M + (variance(a) + variance(b)).sqrt();
    (away.dot(&side) / across_m).powi(2) + (away.dot(&axis) / LINK_ALONG_M).powi(2) <= 1.0
}
