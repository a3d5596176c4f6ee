//! Starts tracks from boxes alone, weak and strong, that no track has.
//!
//! Some cars are seen from high above, or half in the dark. They are found in nearly every inference frame, but with
//! certainty in few. At the picture's edge, the lens may distort the keypoints so much that they fit no car.
//!
//! The boxes are chained in the picture, where no property of the vehicle is needed. They are placed on the ground once
//! the chain shows the direction of travel. Whether the track is a vehicle is decided as for any other track.

use std::{
    collections::{BTreeMap, BTreeSet},
    f64::consts::FRAC_PI_2,
};

use nalgebra::{Matrix2, Vector2, Vector3};
use roadplane_base::{Shape, VehicleClass, bbox_centre, bbox_iou, bbox_share_inside};

use crate::{
    BoxSighting, ExpectedVehicle, Placed, Scene,
    box_motion::BoxMotion,
    expected::SURE_OVERLAP,
    frames::{BoxesByFrame, Frames},
    measurement::Sighting,
    raw_track::RawTrack,
};

/// Time without a box after which a chain ends, s.
const LOST_S: f64 = 0.6;
/// Time constant of the smoothed motion of a chain of boxes in the picture, s.
const MOTION_S: f64 = 0.25;
/// Overlap (IoU) with a track's box above which a box is of that track's vehicle.
const SAME_BOX: f64 = 0.4;
/// A box belongs to a track's vehicle if more than this share of the box lies inside the track's box, 0–1.
const INSIDE: f64 = 0.7;
/// Least share of a chain's boxes that touch one track's boxes if the chain is a part of that vehicle. A lorry's cab is
/// such a part.
const PART: f64 = 0.8;
/// Distance within which a box touches the box of a truck or bus, in shorter sides of the touching box. Boxes of
/// lorries and buses may end that far before the vehicle does.
const APART: f64 = 1.2;
/// Least number of a chain's boxes of which the detector is certain.
const MIN_SURE: usize = 3;
/// Length of one step of a chain's path in the picture, in box sizes (square root of the area).
const STEP_SIZES: f64 = 0.5;
/// Least number of steps of a chain that moves on.
const MIN_STEPS: usize = 3;
/// Least mean cosine between consecutive steps of a chain that moves on: they turn little.
const MIN_COSINE: f64 = 0.8;
/// Half of the time whose positions show the direction of travel, s.
const HEADING_S: f64 = 1.0;
/// Least speed at which positions show the direction of travel, m/s.
const DRIVES_MPS: f64 = 1.0;
/// Sd of a heading that comes from the direction of travel, rad.
const DRIVEN_HEADING_SD: f64 = 0.15;

/// Boxes of one possible vehicle, at most one per frame.
struct Chain {
    /// Boxes with the index of their frame, in the order of time.
    boxes: Vec<(usize, BoxSighting)>,
    /// Motion of the box in the picture.
    motion: BoxMotion,
}

impl Chain {
    /// Starts a chain with its first box, at a time in s.
    fn new(frame: usize, first: BoxSighting, time_s: f64) -> Self {
        Self { boxes: vec![(frame, first)], motion: BoxMotion::new(first.bbox_px, time_s, MOTION_S) }
    }

    /// Adds the next box to the chain, at a time in s.
    fn add(&mut self, frame: usize, seen: BoxSighting, time_s: f64) {
        self.motion.see(seen.bbox_px, time_s);
        self.boxes.push((frame, seen));
    }

    /// Whether the detector is certain of enough of the chain's boxes, as of those of any track.
    fn is_certain(&self) -> bool {
        self.boxes.iter().filter(|(_, seen)| seen.is_sure() && !seen.held).count() >= MIN_SURE
    }

    /// Whether the chain moves on steadily in the picture, in several steps that turn little.
    fn goes_on(&self) -> bool {
        let size = |px: &[f64; 4]| ((px[2] - px[0]) * (px[3] - px[1])).sqrt();
        let mut places = self.boxes.iter().map(|(_, seen)| (bbox_centre(&seen.bbox_px), size(&seen.bbox_px)));
        let Some((mut from, _)) = places.next() else { return false };
        let mut steps: Vec<Vector2<f64>> = Vec::new();
        for (to, size) in places {
            if let Some(direction) = (to - from).try_normalize(STEP_SIZES * size) {
                steps.push(direction);
                from = to;
            }
        }
        let turns = steps.windows(2).map(|pair| pair[0].dot(&pair[1]));
        steps.len() >= MIN_STEPS && turns.sum::<f64>() >= MIN_COSINE * (steps.len() - 1) as f64
    }
}

/// Returns new tracks, made of boxes that are in none of the given tracks.
pub(crate) fn begin(
    free: &BoxesByFrame,
    tracks: &[RawTrack],
    frames: &Frames,
    scene: &impl Scene,
) -> Vec<RawTrack> {
    let taken = boxes_of(tracks, frames);
    let apart: Vec<f64> =
        tracks.iter().map(|track| if track.class() == VehicleClass::Car { 0.0 } else { APART }).collect();
    let none = Vec::new();
    let of_frame = |frame: usize| taken.get(&frame).unwrap_or(&none);
    chains(free, frames, |frame, bbox_px| {
        let is_same = |(_, other): &(usize, [f64; 4])| {
            bbox_iou(bbox_px, other) > SAME_BOX || bbox_share_inside(bbox_px, other) > INSIDE
        };
        !of_frame(frame).iter().any(is_same)
    })
    .into_iter()
    .filter(|chain| !is_part(chain, of_frame, &apart))
    .filter_map(|chain| on_ground(&chain, frames, scene))
    .collect()
}

/// Returns the boxes (px) of the tracks in each inference frame, with the track's index. Where a track was not
/// detected, its box is interpolated.
fn boxes_of(tracks: &[RawTrack], frames: &Frames) -> BTreeMap<usize, Vec<(usize, [f64; 4])>> {
    let mut boxes: BTreeMap<usize, Vec<(usize, [f64; 4])>> = BTreeMap::new();
    for (t, track) in tracks.iter().enumerate() {
        for pair in track.observations.windows(2) {
            let span_s = (pair[1].time_s - pair[0].time_s).max(f64::MIN_POSITIVE);
            for frame in (pair[0].frame..pair[1].frame).filter(|frame| frames.looked[*frame]) {
                let share = (frames.times_s[frame] - pair[0].time_s) / span_s;
                let between =
                    |i: usize| pair[0].bbox_px[i] + share * (pair[1].bbox_px[i] - pair[0].bbox_px[i]);
                boxes.entry(frame).or_default().push((t, std::array::from_fn(between)));
            }
        }
        if let Some(last) = track.observations.last() {
            boxes.entry(last.frame).or_default().push((t, last.bbox_px));
        }
    }
    boxes
}

/// Chains free boxes that follow each other, largest overlaps first. Returns the chains that are vehicles.
fn chains(free: &BoxesByFrame, frames: &Frames, is_free: impl Fn(usize, &[f64; 4]) -> bool) -> Vec<Chain> {
    let (mut open, mut done): (Vec<Chain>, Vec<Chain>) = (Vec::new(), Vec::new());
    for (&frame, boxes) in free {
        let time_s = frames.times_s[frame];
        let ended = open.extract_if(.., |chain| chain.motion.unseen_s(time_s) > LOST_S);
        done.extend(ended.filter(Chain::is_certain));
        let boxes: Vec<&BoxSighting> = boxes.iter().filter(|seen| is_free(frame, &seen.bbox_px)).collect();
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (c, chain) in open.iter().enumerate() {
            let expected_px = chain.motion.at(time_s);
            for (b, seen) in boxes.iter().enumerate() {
                let overlap = bbox_iou(&expected_px, &seen.bbox_px);
                if overlap > SURE_OVERLAP {
                    pairs.push((overlap, c, b));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let (mut went_on, mut used) = (BTreeSet::new(), BTreeSet::new());
        for (_, c, b) in pairs {
            if !went_on.contains(&c) && !used.contains(&b) {
                open[c].add(frame, *boxes[b], time_s);
                went_on.insert(c);
                used.insert(b);
            }
        }
        let new = boxes.iter().enumerate().filter(|(b, _)| !used.contains(b));
        open.extend(new.map(|(_, seen)| Chain::new(frame, **seen, time_s)));
    }
    done.extend(open.into_iter().filter(Chain::is_certain));
    done
}

/// Whether a chain accompanies a track's vehicle and touches it most of the time. `apart` is the distance within which
/// a box touches the box of each track, in shorter sides of the chain's box.
fn is_part<'a>(chain: &Chain, of_frame: impl Fn(usize) -> &'a Vec<(usize, [f64; 4])>, apart: &[f64]) -> bool {
    let mut touched: BTreeMap<usize, usize> = BTreeMap::new();
    for (frame, seen) in &chain.boxes {
        let [x0, y0, x1, y1] = seen.bbox_px;
        for (track, other) in of_frame(*frame) {
            let reach = apart[*track] * (x1 - x0).min(y1 - y0);
            let reached_px = [x0 - reach, y0 - reach, x1 + reach, y1 + reach];
            *touched.entry(*track).or_default() += usize::from(bbox_share_inside(&reached_px, other) > 0.0);
        }
    }
    touched.values().any(|touches| *touches as f64 >= PART * chain.boxes.len() as f64)
}

/// Places a chain's vehicle on the ground; `None` where the camera cannot see it there.
fn on_ground(chain: &Chain, frames: &Frames, scene: &impl Scene) -> Option<RawTrack> {
    let boxes = &chain.boxes;
    let mut vehicle = ExpectedVehicle {
        class: class(boxes),
        dims_m: None,
        shape: Shape::zeros(),
        heading_rad: 0.0,
        heading_sd_rad: FRAC_PI_2,
    };
    let time_s = |frame: usize| frames.times_s[frame];
    let placed = |(frame, seen): &(usize, BoxSighting), vehicle: &ExpectedVehicle| {
        let placed = scene.place(&frames.stamps[*frame], seen, vehicle)?;
        placed.covariance.cholesky().is_some().then_some((*frame, placed))
    };
    let about: Vec<(usize, Placed)> = boxes.iter().filter_map(|one| placed(one, &vehicle)).collect();
    let places: Vec<[f64; 3]> =
        about.iter().map(|(frame, at)| [time_s(*frame), at.pose.x_m, at.pose.y_m]).collect();
    // The box of a stationary car shows its heading, if only roughly. Positions that jitter are no path.
    let way_at = |at: &[f64; 3]| Some([at[0], way(&places, at[0])?]);
    let ways = chain.goes_on().then(|| places.iter().filter_map(way_at).collect::<Vec<[f64; 2]>>());
    let dims: Vec<[Vector3<f64>; 2]> = about.iter().map(|(_, at)| at.dims_m).collect();
    if vehicle.class != VehicleClass::Car {
        vehicle.dims_m = RawTrack::mean_dims_m(&dims);
    }
    let mut sightings = Vec::new();
    for (frame, seen) in boxes {
        let away_s = |way: &&[f64; 2]| (way[0] - time_s(*frame)).abs();
        if let Some(ways) = &ways {
            vehicle.heading_rad = ways.iter().min_by(|a, b| away_s(a).total_cmp(&away_s(b)))?[1];
            vehicle.heading_sd_rad = DRIVEN_HEADING_SD;
        }
        let found = placed(&(*frame, *seen), &vehicle);
        sightings.extend(found.map(|(_, placed)| Sighting::by_box(seen, &placed, *frame, time_s(*frame))));
    }
    RawTrack::by_boxes(sightings, vehicle.class, &dims)
}

/// Returns the class of a chain, by the boxes of which the detector is certain.
fn class(boxes: &[(usize, BoxSighting)]) -> VehicleClass {
    let mut votes: BTreeMap<VehicleClass, f64> = BTreeMap::new();
    for (_, seen) in boxes.iter().filter(|(_, seen)| seen.is_sure()) {
        *votes.entry(seen.class).or_default() += seen.score;
    }
    votes.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(VehicleClass::Car, |(class, _)| class)
}

/// Returns the direction of travel at a time, rad: that of a line through the positions (time, x, y) around it. `None`
/// where the vehicle is too slow.
fn way(places: &[[f64; 3]], at_s: f64) -> Option<f64> {
    let (mut normal, mut right) = (Matrix2::zeros(), [Vector2::zeros(), Vector2::zeros()]);
    for [time_s, x, y] in places.iter().filter(|place| (place[0] - at_s).abs() <= HEADING_S) {
        let basis = Vector2::new(1.0, time_s - at_s);
        normal += basis * basis.transpose();
        right[0] += basis * *x;
        right[1] += basis * *y;
    }
    let line = normal.cholesky()?;
    let [x, y] = right.map(|right| line.solve(&right).y);
    (x.hypot(y) > DRIVES_MPS).then(|| y.atan2(x))
}
