//! Finds parts of vehicles: tracks of boxes alone that accompany another track's vehicle. A lorry's cab is one.

use std::collections::BTreeMap;

use roadplane_base::bbox_iou;

use crate::{frames::Frames, raw_track::RawTrack};

/// Least share of a track's boxes in inference frames that touch another track's boxes if it is a part of that vehicle.
const PART: f64 = 0.8;

/// Returns, for each track, whether it is a part of another track's vehicle.
pub(crate) fn parts(tracks: &[&RawTrack], frames: &Frames) -> Vec<bool> {
    let others = boxes_of(tracks, frames);
    let is_part = |track: &&RawTrack| {
        let mut touched: BTreeMap<usize, usize> = BTreeMap::new();
        let inferred = track.observations.iter().filter(|seen| frames.is_inferred[seen.frame]);
        let count = inferred.clone().count();
        for seen in inferred {
            for (other, other_px) in others.get(&seen.frame).into_iter().flatten() {
                *touched.entry(*other).or_default() +=
                    usize::from(bbox_iou(&seen.detection.bbox_px, other_px) > 0.0);
            }
        }
        touched.values().any(|touches| *touches as f64 >= PART * count as f64)
    };
    tracks.iter().map(|track| track.is_boxed && is_part(track)).collect()
}

/// Returns the boxes (px) in each inference frame of the tracks that are not of boxes alone, with the track's index. Where
/// a track was not detected, its box is interpolated.
fn boxes_of(tracks: &[&RawTrack], frames: &Frames) -> BTreeMap<usize, Vec<(usize, [f64; 4])>> {
    let mut boxes: BTreeMap<usize, Vec<(usize, [f64; 4])>> = BTreeMap::new();
    for (t, track) in tracks.iter().enumerate().filter(|(_, track)| !track.is_boxed) {
        for pair in track.observations.windows(2) {
            let [from_px, to_px] = [&pair[0], &pair[1]].map(|seen| seen.detection.bbox_px);
            let span_s = (pair[1].time_s - pair[0].time_s).max(f64::MIN_POSITIVE);
            for frame in (pair[0].frame..pair[1].frame).filter(|frame| frames.is_inferred[*frame]) {
                let share = (frames.times_s[frame] - pair[0].time_s) / span_s;
                let between = |i: usize| from_px[i] + share * (to_px[i] - from_px[i]);
                boxes.entry(frame).or_default().push((t, std::array::from_fn(between)));
            }
        }
        if let Some(last) = track.observations.last() {
            boxes.entry(last.frame).or_default().push((t, last.detection.bbox_px));
        }
    }
    boxes
}
