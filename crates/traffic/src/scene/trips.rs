//! Trips: the arms by which each vehicle comes and leaves.

use super::{arm::Flow, cluster::FEWEST, corridor::Section, path::Path};

/// The arms by which a vehicle comes and leaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Trip {
    /// Index of the arm, if the vehicle was seen on it.
    pub from: Option<usize>,
    /// Index of the arm, if the vehicle was seen on it.
    pub to: Option<usize>,
}

/// Returns the trip of a path: from the first gate into the scene, to the last gate out of it.
pub(super) fn trip(path: &Path, sections: &[Section]) -> Trip {
    let mut all: Vec<(f64, usize, bool)> = Vec::new();
    for (arm, section) in sections.iter().enumerate() {
        all.extend(section.crossings(path, 0.0).map(|(enters, along_m, _)| (along_m, arm, enters)));
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let from = all.iter().find(|crossing| crossing.2);
    let to = all.iter().rfind(|crossing| !crossing.2 && from.is_none_or(|from| crossing.0 > from.0));
    Trip { from: from.map(|crossing| crossing.1), to: to.map(|crossing| crossing.1) }
}

/// Returns the flows with at least `FEWEST` vehicles, sorted by arms.
pub(super) fn flows(trips: &[Trip], arms: usize) -> Vec<Flow> {
    let count =
        |from, to| trips.iter().filter(|trip| **trip == Trip { from: Some(from), to: Some(to) }).count();
    (0..arms)
        .flat_map(|from| (0..arms).map(move |to| (from, to)))
        .map(|(from, to)| Flow { from, to, vehicles: count(from, to) })
        .filter(|flow| flow.vehicles >= FEWEST)
        .collect()
}
