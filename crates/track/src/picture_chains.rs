//! Chains the boxes that no tracklet has, weak and strong, in the picture.
//!
//! Some vehicles are seen from high above, or half in the dark. They are detected in nearly every inference frame, but
//! with certainty in few. At the picture's edge, the lens may distort the keypoints so much that they fit no car. In
//! the picture, boxes follow each other without any property of the vehicle.
//!
//! A chain may run into the first box of a tracklet, and it goes on from a tracklet's last box. Then it shows the same
//! vehicle, if linking agrees.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{bbox_centre, bbox_iou};

use crate::{
    Detection,
    box_motion::{BoxMotion, COAST_S},
    expected::SURE_OVERLAP,
    filter::MOTION_S,
    frames::BoxesByFrame,
    raw_track::{FEWEST, RawTrack},
};

/// Length of one step of a chain's path in the picture, in box sizes (square root of the area).
const STEP_SIZES: f64 = 0.5;

/// Boxes of one possible vehicle, at most one per frame.
pub(crate) struct Chain {
    /// Boxes with the index of their frame, in the order of time. Boxes of the tracklet are not among them.
    pub boxes: Vec<(usize, Detection)>,
    /// Index of the tracklet that the boxes precede or follow.
    pub tracklet: Option<usize>,
    motion: BoxMotion,
}

impl Chain {
    /// Whether another object may be at the position of the last box: the vehicle has moved by half its size since then,
    /// or [`MOTION_S`] has passed.
    fn is_lost(&self, time_s: f64) -> bool {
        let (last_px, unseen_s) = (&self.motion.last_px, self.motion.unseen_s(time_s));
        let moved_px = (bbox_centre(&self.motion.at(time_s)) - bbox_centre(last_px)).norm();
        unseen_s > COAST_S && (unseen_s > MOTION_S || moved_px > STEP_SIZES * size_px(last_px))
    }

    /// Whether the chain moves on in the picture, in several steps.
    pub(crate) fn goes_on(&self) -> bool {
        let mut places =
            self.boxes.iter().map(|(_, seen)| (bbox_centre(&seen.bbox_px), size_px(&seen.bbox_px)));
        let Some((mut from, _)) = places.next() else { return false };
        let mut steps = 0;
        for (to, size) in places {
            if (to - from).norm() > STEP_SIZES * size {
                steps += 1;
                from = to;
            }
        }
        steps >= FEWEST
    }
}

/// Returns the square root of a box's area, px.
pub(crate) fn size_px([x0, y0, x1, y1]: &[f64; 4]) -> f64 {
    ((x1 - x0) * (y1 - y0)).sqrt()
}

/// A box of one frame that may continue a chain, with the index of its tracklet if it has one.
type Next<'a> = (Option<usize>, &'a Detection);

/// Chains boxes that follow each other in the picture, largest overlaps first. Returns the chains that have free boxes.
///
/// `times_s` are the times of all frames. The next box of a chain overlaps the expected one by more than `least` (IoU).
pub(crate) fn chains(free: &BoxesByFrame, tracklets: &[RawTrack], times_s: &[f64], least: f64) -> Vec<Chain> {
    let mut owned: BTreeMap<usize, Vec<Next<'_>>> = BTreeMap::new();
    for (index, track) in tracklets.iter().enumerate() {
        for seen in &track.observations {
            owned.entry(seen.frame).or_default().push((Some(index), &seen.detection));
        }
    }
    let ends =
        |index: usize| tracklets[index].observations.last().map_or(f64::NEG_INFINITY, |last| last.time_s);
    let (mut open, mut done): (Vec<Chain>, Vec<Chain>) = (Vec::new(), Vec::new());
    for frame in free.keys().chain(owned.keys()).copied().collect::<BTreeSet<usize>>() {
        let time_s = times_s[frame];
        let has_ended = |chain: &mut Chain| {
            chain.is_lost(time_s) && chain.tracklet.is_none_or(|index| ends(index) < time_s)
        };
        done.extend(open.extract_if(.., has_ended));
        let boxes = free.get(&frame).into_iter().flatten().map(|seen| (None, seen));
        let all: Vec<Next<'_>> = owned.get(&frame).into_iter().flatten().copied().chain(boxes).collect();
        continue_chains(&mut open, &all, frame, time_s, least);
    }
    done.extend(open);
    done.retain(|chain| !chain.boxes.is_empty());
    done
}

/// Continues chains by the boxes of a frame, each by at most one, and starts chains with the others.
fn continue_chains(open: &mut Vec<Chain>, all: &[Next<'_>], frame: usize, time_s: f64, least: f64) {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (c, chain) in open.iter().enumerate() {
        let expected_px = chain.motion.at(time_s);
        for (b, (tracklet, seen)) in all.iter().enumerate() {
            let overlap = match (chain.tracklet, tracklet) {
                // The chain of a tracklet has the tracklet's boxes, and of no other.
                (Some(own), Some(index)) => f64::from(u8::from(own == *index)),
                // In a long gap of a tracklet, other vehicles pass.
                (Some(_), None) if chain.is_lost(time_s) => 0.0,
                _ => bbox_iou(&expected_px, &seen.bbox_px),
            };
            if overlap > least {
                pairs.push((overlap, c, b));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut went_on, mut used) = (BTreeSet::new(), BTreeSet::new());
    for (_, c, b) in pairs {
        let (tracklet, seen) = all[b];
        let has_chain = |index: usize| {
            open[c].tracklet.is_none() && open.iter().any(|other| other.tracklet == Some(index))
        };
        if went_on.contains(&c) || used.contains(&b) || tracklet.is_some_and(has_chain) {
            continue;
        }
        match tracklet {
            Some(index) => open[c].tracklet = Some(index),
            None => open[c].boxes.push((frame, *seen)),
        }
        open[c].motion.see(seen.bbox_px, time_s);
        went_on.insert(c);
        used.insert(b);
    }
    for (_, (tracklet, seen)) in all.iter().enumerate().filter(|(b, _)| !used.contains(b)) {
        let has_box =
            |(own, other): &Next<'_>| own.is_some() && bbox_iou(&other.bbox_px, &seen.bbox_px) > SURE_OVERLAP;
        // A second box of a tracklet's vehicle starts no chain.
        if tracklet.is_none() && all.iter().any(has_box) {
            continue;
        }
        let boxes = if tracklet.is_none() { vec![(frame, **seen)] } else { Vec::new() };
        let motion = BoxMotion::new(seen.bbox_px, time_s);
        open.push(Chain { boxes, tracklet: *tracklet, motion });
    }
}
