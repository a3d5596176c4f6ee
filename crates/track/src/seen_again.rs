//! Detections of vehicles in frames in which nothing measured their poses.

use std::collections::BTreeMap;

use roadplane_base::CarRef;

use crate::{SeenAgain, Track};

/// Adds detections to the states of their tracks. Each has the index of its frame, and belongs to the track of the
/// measurement before it. It does not change the position.
pub(crate) fn add_detections(tracks: &mut [Track], detections: &[(u64, SeenAgain)]) {
    let mut owners: BTreeMap<CarRef, usize> = BTreeMap::new();
    for (owner, track) in tracks.iter().enumerate() {
        let measured = |frame: u64, car: Option<usize>| Some(CarRef { frame, car: car? });
        let looks = track.states.iter().filter_map(|state| measured(state.stamp.index, state.car));
        owners.extend(looks.map(|look| (look, owner)));
    }
    for (frame, seen) in detections {
        let Some(&owner) = owners.get(&seen.look) else { continue };
        let states = &mut tracks[owner].states;
        let Ok(at) = states.binary_search_by_key(frame, |state| state.stamp.index) else { continue };
        let state = &mut states[at];
        if !state.observed {
            (state.observed, state.bbox_px, state.score) = (true, Some(seen.bbox_px), seen.score);
        }
    }
}
