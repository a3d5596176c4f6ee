//! Turns tracklets into tracks, after the last frame.

use std::collections::BTreeSet;

use roadplane_base::FrameStamp;

use crate::{
    Evidence, Join, Scene, Track, TrackOptions, TrackState, TrackStep,
    box_motion::COAST_S,
    duplicates::{merge_duplicates, merge_smoothed},
    frames::{BoxesByFrame, Frames},
    link::link,
    measurement::Observation,
    parts::parts,
    path::smooth_track,
    placed_boxes::add_boxes,
    raw_track::{FEWEST, Link, RawTrack},
    smooth_boxes::smooth_by_boxes,
};

/// The result of a tracker.
#[derive(Clone, Debug, Default)]
pub struct Tracks {
    /// Tracks, ordered by first frame and then by x.
    pub tracks: Vec<Track>,
    /// Time stamp of the first detection of each track that is left out, because it is probably no vehicle.
    pub left_out: Vec<FrameStamp>,
}

/// Returns all tracks that are probably vehicles.
pub(crate) fn complete(
    tracklets: Vec<RawTrack>,
    mut free: BoxesByFrame,
    frames: &Frames,
    options: &TrackOptions,
    scene: &impl Scene,
) -> Tracks {
    let least = options.min_observed.min(frames.counted.div_ceil(2));
    let mut completion = Completion { frames, options, scene, least, left_out: Vec::new() };
    let mut tracklets = completion.merged(tracklets);
    if options.takes(TrackStep::Boxes) && !free.is_empty() {
        leave_out(&mut free, &tracklets);
        tracklets = add_boxes(tracklets, &free, frames, scene);
    }
    let linked = completion.linked(tracklets);
    let kept = completion.vehicles(linked);
    let is_part = parts(&kept.iter().map(|(raw, ..)| raw).collect::<Vec<&RawTrack>>(), frames);
    let kept = kept.into_iter().zip(is_part).filter_map(|(one, is_part)| (!is_part).then_some(one));
    let mut tracks: Vec<Track> = kept.map(|one| completion.finished(one)).collect();
    let key = |track: &Track| track.states.first().map(|s| (s.stamp.index, s.pose.x_m, s.pose.y_m));
    tracks.sort_by(|a, b| match (key(a), key(b)) {
        (Some(a), Some(b)) => a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)),
        (a, b) => a.is_some().cmp(&b.is_some()),
    });
    for (id, track) in (1..).zip(&mut tracks) {
        track.id = id;
    }
    Tracks { tracks, left_out: completion.left_out }
}

/// A track that is probably a vehicle, its smoothed states, and the evidence for it.
type Kept = (RawTrack, Vec<TrackState>, Evidence);

/// The steps that turn tracklets into tracks.
struct Completion<'a, S> {
    frames: &'a Frames,
    options: &'a TrackOptions,
    scene: &'a S,
    /// Least number of detections of a track.
    least: usize,
    /// Time stamp of the first detection of each track that is left out, because it is probably no vehicle.
    left_out: Vec<FrameStamp>,
}

impl<S: Scene> Completion<'_, S> {
    /// Merges tracklets of one vehicle, first by single detections and then by smoothed poses.
    fn merged(&self, tracklets: Vec<RawTrack>) -> Vec<RawTrack> {
        if !self.options.takes(TrackStep::Merge) {
            return tracklets;
        }
        self.smoothed(merge_duplicates(tracklets)).into_iter().map(|(raw, _)| raw).collect()
    }

    /// Smooths tracks, and merges those of one vehicle by their smoothed poses. Returns them with their states.
    fn smoothed(&self, tracks: Vec<RawTrack>) -> Vec<(RawTrack, Vec<TrackState>)> {
        let smooth = |track: &RawTrack| smooth_track(track, self.frames);
        if self.options.takes(TrackStep::Merge) {
            return merge_smoothed(tracks, smooth);
        }
        let states: Vec<Vec<TrackState>> = tracks.iter().map(smooth).collect();
        tracks.into_iter().zip(states).collect()
    }

    /// Links tracklets over gaps.
    fn linked(&self, tracklets: Vec<RawTrack>) -> Vec<RawTrack> {
        if !self.options.takes(TrackStep::Link) {
            return tracklets;
        }
        let log_odds = |raw: &RawTrack| {
            let evidence = self.evidence(raw, &[]).filter(|_| raw.is_boxed);
            evidence.map(|evidence| evidence.log_odds())
        };
        link(tracklets, self.options.takes(TrackStep::Cut), log_odds)
    }

    /// Collects the evidence whether a track with these smoothed states is a vehicle; `None` without a detection.
    fn evidence(&self, raw: &RawTrack, states: &[TrackState]) -> Option<Evidence> {
        let (class, shape) = (raw.class(), raw.shape.fused().mean);
        let dims_m = raw.dims_m().unwrap_or_else(|| self.scene.body(class, &shape).dims_m);
        Evidence::of(&raw.observations, states, class, dims_m.z - self.scene.mean_car().z)
    }

    /// Smooths tracks, and returns those that are probably vehicles. The others are listed as left out. Tracks without
    /// enough detections are dropped.
    fn vehicles(&mut self, mut tracks: Vec<RawTrack>) -> Vec<Kept> {
        tracks.retain(|raw| {
            let is_certain = !raw.is_boxed || raw.certain >= FEWEST;
            raw.observations.len() + raw.seen_again >= self.least && is_certain
        });
        let mut vehicles = Vec::new();
        for (raw, states) in self.smoothed(tracks) {
            let Some((first, evidence)) = states.first().zip(self.evidence(&raw, &states)) else { continue };
            let is_probable = evidence.probability() >= self.options.min_exists_p;
            if is_probable || !self.options.takes(TrackStep::Existence) {
                vehicles.push((raw, states, evidence));
            } else {
                self.left_out.push(first.stamp);
            }
        }
        vehicles
    }

    /// Returns the joins of a track over gaps. Tracklets that overlap, or that other detections connect, leave no gap.
    fn joins(&self, raw: &RawTrack) -> Vec<Join> {
        let stamp = |seen: &Observation| self.frames.stamps[seen.frame];
        let join = |link: &Link| {
            let to = raw.observations.partition_point(|seen| seen.frame < link.frame);
            let (from, to) = raw.observations.get(to.checked_sub(1)?).zip(raw.observations.get(to))?;
            let is_gap = to.time_s - from.time_s > COAST_S;
            is_gap.then(|| Join { from: stamp(from), to: stamp(to), log_odds: link.log_odds })
        };
        raw.links.iter().filter_map(join).collect()
    }

    /// Returns the finished track. Where only boxes show the vehicle, they give its path and its size together.
    fn finished(&self, (raw, states, evidence): Kept) -> Track {
        let (class, dims_m, shape) = (raw.class(), raw.dims_m(), raw.shape.fused());
        let joins = self.joins(&raw);
        let track = Track { id: 0, class, dims_m, dims_covariance: None, states, shape, evidence, joins };
        if !self.options.takes(TrackStep::ByBoxes) {
            return track;
        }
        match smooth_by_boxes(&raw, self.frames, self.scene) {
            Some((states, body)) => Track {
                dims_m: dims_m.map(|_| body.dims_m),
                dims_covariance: dims_m.map(|_| body.covariance),
                states,
                ..track
            },
            None => track,
        }
    }
}

/// Removes the boxes that tracks have already.
fn leave_out(free: &mut BoxesByFrame, tracks: &[RawTrack]) {
    let seen = tracks.iter().flat_map(|track| &track.observations);
    let owned: BTreeSet<(usize, usize)> =
        seen.filter_map(|seen| Some((seen.frame, seen.detection.car?))).collect();
    for (frame, boxes) in free {
        boxes.retain(|seen| seen.car.is_none_or(|car| !owned.contains(&(*frame, car))));
    }
}
