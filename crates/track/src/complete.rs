//! Turns tracklets into tracks, after the last frame.

use std::collections::BTreeSet;

use nalgebra::{Vector2, Vector3};
use roadplane_base::{FrameStamp, GroundPose, Shape, VehicleClass};
use roadplane_measure::{Body, GroundContact, Knowledge, body_of};

use crate::{
    Detection, Evidence, Join, Track, TrackOptions, TrackState, TrackStep,
    box_motion::COAST_S,
    duplicates::{merge_duplicates, merge_smoothed},
    frames::{BoxesByFrame, Frames},
    link::link,
    measurement::Sighting,
    parts::parts,
    placed_boxes::add_boxes,
    raw_track::{FEWEST, Link, RawTrack},
    smooth::smooth_track,
    smooth_boxes::smooth_by_boxes,
};

/// Knowledge of the scene, beyond the detections. It converts between boxes and poses.
pub trait Scene {
    /// Returns the body of vehicles of a class, for cars with this shape. By default, it is the mean body of the class.
    fn body(&self, class: VehicleClass, _shape: &Shape) -> Body {
        body_of(class)
    }

    /// Returns length, width and height of the site's mean car, m.
    fn mean_car(&self) -> Vector3<f64> {
        body_of(VehicleClass::Car).dims_m
    }

    /// Returns the box in which such a vehicle would be visible, px; `None` where it is not in front of the camera.
    fn body_px(
        &self,
        _stamp: &FrameStamp,
        _pose: &GroundPose,
        _class: VehicleClass,
        _dims_m: &Vector3<f64>,
    ) -> Option<[f64; 4]> {
        None
    }

    /// Returns pose and size of the vehicle in a box of this frame; `None` where the box does not place it.
    fn place(&self, stamp: &FrameStamp, seen: &Detection, known: &Knowledge) -> Option<GroundContact>;
}

/// A scene without a camera: boxes give no poses.
impl Scene for () {
    fn place(&self, _: &FrameStamp, _: &Detection, _: &Knowledge) -> Option<GroundContact> {
        None
    }
}

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
    let least = options.min_observed.min(frames.looks.div_ceil(2));
    let mut completion = Completion { frames, options, scene, least, left_out: Vec::new() };
    let mut tracklets = completion.merged(tracklets);
    if options.takes(TrackStep::Boxes) && !free.is_empty() {
        leave_out(&mut free, &tracklets);
        tracklets = add_boxes(tracklets, &free, frames, scene);
    }
    let linked = completion.linked(tracklets);
    let kept = completion.vehicles(linked);
    let is_part = parts(&kept.iter().map(|one| &one.raw).collect::<Vec<&RawTrack>>(), frames);
    let kept = kept.into_iter().zip(is_part).filter_map(|(one, is_part)| (!is_part).then_some(one));
    let mut tracks: Vec<Track> = kept.map(|one| completion.finished(one)).collect();
    tracks.retain(|track| !track.states.is_empty());
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

/// A smoothed track that is probably a vehicle.
struct Kept {
    /// Track before smoothing.
    raw: RawTrack,
    /// Smoothed states, one for each frame.
    states: Vec<TrackState>,
    /// All that shows whether it is a vehicle.
    evidence: Evidence,
}

/// The steps that turn tracklets into tracks.
struct Completion<'a, S> {
    /// All frames.
    frames: &'a Frames,
    /// Settings of the tracker.
    options: &'a TrackOptions,
    /// Knowledge of the scene.
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
        self.merged_smoothed(merge_duplicates(tracklets)).into_iter().map(|(raw, _)| raw).collect()
    }

    /// Merges tracks of one vehicle by their smoothed poses. Returns them with their states.
    fn merged_smoothed(&self, tracks: Vec<RawTrack>) -> Vec<(RawTrack, Vec<TrackState>)> {
        merge_smoothed(tracks, |track| smooth_track(track, self.frames))
    }

    /// Links tracklets over gaps.
    fn linked(&self, tracklets: Vec<RawTrack>) -> Vec<RawTrack> {
        if !self.options.takes(TrackStep::Link) {
            return tracklets;
        }
        let log_odds = |raw: &RawTrack| {
            if !raw.is_boxed {
                return None;
            }
            Some(self.evidence(raw, |seen| Some(seen.pose.xy()))?.log_odds())
        };
        link(tracklets, self.options.takes(TrackStep::Cut), log_odds)
    }

    /// Collects what shows whether a track is a vehicle; `None` without a detection. `at` returns its position at a
    /// detection, m.
    fn evidence(&self, raw: &RawTrack, at: impl Fn(&Sighting) -> Option<Vector2<f64>>) -> Option<Evidence> {
        let (class, shape) = (raw.class(), raw.shape.fused().mean);
        let dims_m = raw.dims_m().unwrap_or_else(|| self.scene.body(class, &shape).dims_m);
        Evidence::of(&raw.observations, at, class, dims_m.z - self.scene.mean_car().z)
    }

    /// Smooths tracks, and returns those that are probably vehicles. The others are listed as left out. Tracks without
    /// enough detections are dropped.
    fn vehicles(&mut self, mut tracks: Vec<RawTrack>) -> Vec<Kept> {
        tracks.retain(|raw| {
            let is_certain = !raw.is_boxed || raw.certain >= FEWEST;
            raw.observations.len() + raw.seen_again >= self.least && is_certain
        });
        let smoothed = if self.options.takes(TrackStep::Merge) {
            self.merged_smoothed(tracks)
        } else {
            let with_states = |raw: RawTrack| {
                let states = smooth_track(&raw, self.frames);
                (raw, states)
            };
            tracks.into_iter().map(with_states).collect()
        };
        let mut vehicles = Vec::new();
        for (raw, states) in smoothed {
            let Some((first, state)) = raw.observations.first().zip(states.first()) else { continue };
            let (first, stamp) = (first.frame, state.stamp);
            let at = |seen: &Sighting| {
                states.get(seen.frame - first).map(|state| Vector2::new(state.pose.x_m, state.pose.y_m))
            };
            let Some(evidence) = self.evidence(&raw, at) else { continue };
            let evidence = evidence.with_states(&states);
            if !self.options.takes(TrackStep::Existence)
                || evidence.probability() >= self.options.min_exists_p
            {
                vehicles.push(Kept { raw, states, evidence });
            } else {
                self.left_out.push(stamp);
            }
        }
        vehicles
    }

    /// Returns the joins of a track over gaps. Tracklets that overlap, or that other detections connect, leave no gap.
    fn joins(&self, raw: &RawTrack) -> Vec<Join> {
        let stamp = |seen: &Sighting| self.frames.stamps[seen.frame];
        let join = |link: &Link| {
            let to = raw.observations.partition_point(|seen| seen.frame < link.frame);
            let (from, to) = raw.observations.get(to.checked_sub(1)?).zip(raw.observations.get(to))?;
            let is_gap = to.time_s - from.time_s > COAST_S;
            is_gap.then(|| Join { from: stamp(from), to: stamp(to), log_odds: link.log_odds })
        };
        raw.links.iter().filter_map(join).collect()
    }

    /// Returns the finished track. Where only boxes show the vehicle, they give its path and its size together.
    fn finished(&self, Kept { raw, states, evidence }: Kept) -> Track {
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
