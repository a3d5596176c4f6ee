//! The arms' gates, from groups of border events.

use super::{
    border::{self, Event, SAME_DIRECTION_COS},
    cluster::{self, FEWEST, LINK_ACROSS_M},
    corridor::{Section, gate_section},
    path::Path,
};

/// A road with its gate and events.
#[derive(Clone, Debug)]
struct Road {
    section: Section,
    events: Vec<Event>,
}

/// Returns the sections of all arms.
pub(super) fn sections(paths: &[Path]) -> Vec<Section> {
    let events = border::events(paths);
    let build = |events: Vec<Event>| gate_section(paths, &events).map(|section| Road { section, events });
    let mut roads: Vec<Road> = cluster::groups(paths, &events).into_iter().filter_map(build).collect();
    while let Some((a, b)) = same_road(paths, &roads) {
        let mut events = roads.remove(b).events;
        events.extend(roads.remove(a).events);
        events.sort_by_key(|event| (event.path, event.enters));
        roads.extend(build(events));
    }
    let hidden: Vec<bool> = roads.iter().map(|road| roads.iter().any(|other| face(road, other))).collect();
    let mut hidden = hidden.into_iter();
    roads.retain(|_| !hidden.next().unwrap_or(false));
    roads.into_iter().map(|road| road.section).filter(|section| users(paths, section) >= FEWEST).collect()
}

/// Returns two groups of events on one road: most vehicles of one group cross the gate of the other, or pass beside it,
/// in the same direction. The smaller index comes first.
fn same_road(paths: &[Path], roads: &[Road]) -> Option<(usize, usize)> {
    let pairs = (0..roads.len()).flat_map(|a| (a + 1..roads.len()).map(move |b| (a, b)));
    let crosses = |from: &Road, to: &Road| {
        if from.section.outward.dot(&to.section.outward) < SAME_DIRECTION_COS {
            return false;
        }
        let crosses = |event: &&Event| {
            to.section.crossings(&paths[event.path], LINK_ACROSS_M).any(|crossing| crossing.0 == event.enters)
        };
        2 * from.events.iter().filter(crosses).count() > from.events.len()
    };
    let mut pairs = pairs.filter(|&(a, b)| crosses(&roads[a], &roads[b]) || crosses(&roads[b], &roads[a]));
    pairs.next()
}

/// Whether two roads lead to each other: vehicles are hidden between them.
fn face(a: &Road, b: &Road) -> bool {
    let (a, b) = (&a.section, &b.section);
    let away = b.middle - a.middle;
    a.outward.dot(&b.outward) < -SAME_DIRECTION_COS
        && away.dot(&a.outward) > 0.0
        && away.perp(&a.outward).abs() < a.half_m + b.half_m
}

/// Returns the number of vehicles that cross a gate.
fn users(paths: &[Path], section: &Section) -> usize {
    paths.iter().filter(|path| section.crossings(path, 0.0).next().is_some()).count()
}
