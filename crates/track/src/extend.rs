//! Extends tracks by boxes that no track has, most of them weak. The detector is trusted with an uncertain box where a
//! vehicle is expected (the second association of Zhang et al. 2022, "ByteTrack"). The search runs forwards from a
//! track's last detection and backwards from its first. It ends where no such box follows. These boxes give positions
//! only.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{assign, bbox_iou, wrap_angle};

use crate::{
    ExpectedVehicle, Scene, TrackOptions,
    expected::{ALONE, Expected, SURE_OVERLAP},
    frames::{BoxesByFrame, Frames},
    measurement::Sighting,
    raw_track::RawTrack,
};

/// Longest time between successive boxes of an extension, s. A later weak box may be of another vehicle, even at the
/// same position.
const MAX_GAP_S: f64 = 3.0;

/// Speed below which a vehicle is about to stop, or sets off, m/s. The search for it lasts as long as its box can be
/// predicted.
const CREEPS_MPS: f64 = 1.0;
/// Speed above which a vehicle takes no box that another object occupies, m/s. Such a box is there before and after the
/// vehicle passes.
const DRIVES_MPS: f64 = 3.5;
/// Time before and after a frame in which boxes of a stationary object are searched for, s.
const STANDS_S: f64 = 2.0;
/// The search for a stationary object skips this time before and after a frame, s. The vehicle itself passes then.
const PASSES_S: f64 = 0.5;
/// Overlap (IoU) above which two boxes are of the same stationary object.
const STANDS_OVERLAP: f64 = 0.6;

/// The extension of one track beyond one of its ends.
struct Reach {
    /// Index of the track.
    track: usize,
    /// Properties of the vehicle.
    vehicle: ExpectedVehicle,
    /// Prediction of the vehicle, in the direction of the search.
    expected: Expected,
    /// Detections that were found, in the order of the search.
    found: Vec<Sighting>,
}

/// Extends tracks at both ends, and removes their boxes from `free`. A box goes to one track at most.
pub(crate) fn extend(
    tracks: &mut [RawTrack],
    free: &mut BoxesByFrame,
    frames: &Frames,
    options: &TrackOptions,
    scene: &impl Scene,
) {
    for forwards in [true, false] {
        for Reach { track, mut found, .. } in reach(tracks, forwards, free, frames, options, scene) {
            if found.is_empty() {
                continue;
            }
            let all = &mut tracks[track].observations;
            if forwards {
                all.append(&mut found);
            } else {
                found.reverse();
                found.append(all);
                *all = found;
            }
        }
    }
}

/// Searches for the boxes of all tracks beyond their last detection (`forwards`) or before their first.
fn reach(
    tracks: &[RawTrack],
    forwards: bool,
    free: &mut BoxesByFrame,
    frames: &Frames,
    options: &TrackOptions,
    scene: &impl Scene,
) -> Vec<Reach> {
    // Before the first detection, time runs backwards.
    let sign = if forwards { 1.0 } else { -1.0 };
    let mut edges: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, track) in tracks.iter().enumerate() {
        let edge = if forwards { track.observations.last() } else { track.observations.first() };
        if let Some(edge) = edge {
            edges.entry(edge.frame).or_default().push(i);
        }
    }
    let (mut open, mut done): (Vec<Reach>, Vec<Reach>) = (Vec::new(), Vec::new());
    let count = frames.stamps.len();
    for step in 0..count {
        let frame = if forwards { step } else { count - 1 - step };
        let time_s = sign * frames.times_s[frame];
        if frames.looked[frame] && !open.is_empty() {
            let lost = |reach: &mut Reach| {
                let creeps = reach.expected.filter.speed() < CREEPS_MPS;
                reach.expected.unseen_s(time_s) > MAX_GAP_S
                    || !creeps && reach.expected.is_lost(time_s, options)
            };
            done.extend(open.extract_if(.., lost));
            let taken = find(&mut open, free, (frame, sign), frames, options, scene);
            if let Some(boxes) = free.get_mut(&frame) {
                let mut index = 0..;
                boxes.retain(|_| index.next().is_none_or(|w| !taken.contains(&w)));
            }
        }
        for &track in edges.get(&frame).into_iter().flatten() {
            let expected = replayed(&tracks[track].observations, sign, options.gate);
            let vehicle = vehicle(&tracks[track]);
            open.extend(expected.map(|expected| Reach { track, vehicle, expected, found: Vec::new() }));
        }
    }
    done.extend(open);
    done
}

/// Assigns the boxes of a frame to the vehicles that are expected there, and returns the indices of these boxes. `sign`
/// is −1 where time runs backwards, else 1.
fn find(
    open: &mut [Reach],
    free: &BoxesByFrame,
    (frame, sign): (usize, f64),
    frames: &Frames,
    options: &TrackOptions,
    scene: &impl Scene,
) -> BTreeSet<usize> {
    let Some(boxes) = free.get(&frame) else { return BTreeSet::new() };
    let time_s = sign * frames.times_s[frame];
    let mut sightings: BTreeMap<(usize, usize), Sighting> = BTreeMap::new();
    for (r, reach) in open.iter_mut().enumerate() {
        reach.vehicle.heading_rad = wrap_angle(reach.expected.filter.axis());
        reach.vehicle.heading_sd_rad = reach.expected.filter.axis_sd();
        for (w, seen) in boxes.iter().enumerate() {
            // A box that does not match in the picture needs no position on the ground.
            if reach.expected.overlap(&seen.bbox_px, seen.goes_on(), time_s) > SURE_OVERLAP
                && let Some(placed) = scene.place(&frames.stamps[frame], seen, &reach.vehicle)
                && placed.covariance.cholesky().is_some()
                && !(reach.expected.filter.speed() > DRIVES_MPS && stands(&seen.bbox_px, frame, free, frames))
            {
                sightings.insert((r, w), Sighting::by_box(seen, &placed, frame, time_s));
            }
        }
    }
    if sightings.is_empty() {
        return BTreeSet::new();
    }
    let pairs = assign(open.len(), boxes.len(), ALONE, |r, w| {
        let sighting = sightings.get(&(r, w));
        sighting.map_or(f64::INFINITY, |sighting| open[r].expected.box_cost(sighting, options.gate))
    });
    let mut taken = BTreeSet::new();
    for (r, (reach, w)) in open.iter_mut().zip(pairs).enumerate() {
        let Some((w, sighting)) = w.and_then(|w| Some((w, sightings.remove(&(r, w))?))) else { continue };
        reach.expected.add_box(&sighting, options.gate);
        reach.found.push(Sighting { time_s: frames.times_s[frame], ..sighting });
        taken.insert(w);
    }
    taken
}

/// Whether there is such a box at this position before and after, too, as there is for a stationary object.
fn stands(bbox_px: &[f64; 4], frame: usize, free: &BoxesByFrame, frames: &Frames) -> bool {
    let (mut looks, mut found) = (0, 0);
    let from = frames.times_s.partition_point(|t| *t < frames.times_s[frame] - STANDS_S);
    for other in (from..frames.times_s.len()).filter(|f| frames.looked[*f]) {
        let away_s = (frames.times_s[other] - frames.times_s[frame]).abs();
        if away_s > STANDS_S {
            break;
        }
        if away_s >= PASSES_S {
            looks += 1;
            let boxes = free.get(&other).into_iter().flatten();
            found += usize::from(boxes.into_iter().any(|b| bbox_iou(&b.bbox_px, bbox_px) > STANDS_OVERLAP));
        }
    }
    looks > 0 && 2 * found > looks
}

/// Returns the prediction of a vehicle after all its detections, or `None` without any. With `sign` −1 time runs
/// backwards, and the first detection comes last.
fn replayed(sightings: &[Sighting], sign: f64, gate: f64) -> Option<Expected> {
    let mut expected: Option<Expected> = None;
    let mut take = |sighting: &Sighting| {
        let sighting = Sighting { time_s: sign * sighting.time_s, ..sighting.clone() };
        match &mut expected {
            None => expected = Some(Expected::new(&sighting)),
            Some(expected) if sighting.held => expected.hold(sighting.bbox_px, sighting.time_s),
            Some(expected) => expected.add(&sighting, gate),
        }
    };
    if sign > 0.0 {
        sightings.iter().for_each(&mut take)
    } else {
        sightings.iter().rev().for_each(&mut take)
    }
    expected
}

/// Returns the properties of a track's vehicle. The heading is filled in for each frame.
fn vehicle(track: &RawTrack) -> ExpectedVehicle {
    ExpectedVehicle {
        class: track.class(),
        dims_m: track.dims_m(),
        shape: track.shape.fused().mean,
        heading_rad: 0.0,
        heading_sd_rad: 0.0,
    }
}
