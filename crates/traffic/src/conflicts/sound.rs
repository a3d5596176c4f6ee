//! Leaves out conflicts of vehicles whose paths cannot be right.
//!
//! Footprints of two vehicles overlap in a crash only. Errors of positions and lengths are much more frequent: a track may
//! change from one vehicle to another, for example. So around an overlap, the other conflicts of both vehicles are doubtful,
//! too.

use std::collections::BTreeMap;

use super::conflict::{Conflict, ConflictLimits};

/// Returns the conflicts that are no overlaps, and that are more than `horizon_s` away from all overlaps of their vehicles.
pub(crate) fn sound(conflicts: Vec<Conflict>, limits: &ConflictLimits) -> Vec<Conflict> {
    let mut overlaps_s: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    for overlap in conflicts.iter().filter(|conflict| conflict.is_overlap()) {
        for track in [overlap.first, overlap.second] {
            overlaps_s.entry(track).or_default().push(overlap.at_s);
        }
    }
    let is_doubtful = |conflict: &Conflict| {
        let of_vehicles =
            [conflict.first, conflict.second].into_iter().filter_map(|track| overlaps_s.get(&track));
        of_vehicles.flatten().any(|at_s| (conflict.at_s - at_s).abs() <= limits.horizon_s)
    };
    conflicts.into_iter().filter(|conflict| !is_doubtful(conflict)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conflicts_near_an_overlap_of_their_vehicle_are_left_out() {
        let of = |first: u64, second: u64, at_s: f64, min_ttc_s: f64| Conflict {
            first,
            second,
            at_s,
            min_ttc_s: Some(min_ttc_s),
            ..Conflict::default()
        };
        let all = vec![of(1, 2, 10.0, 0.0), of(2, 3, 14.0, 1.0), of(3, 4, 14.0, 1.0), of(1, 5, 16.0, 1.0)];
        let left: Vec<_> =
            sound(all, &ConflictLimits::default()).iter().map(|c| (c.first, c.second)).collect();
        assert_eq!(left, [(3, 4), (1, 5)]);
    }
}
