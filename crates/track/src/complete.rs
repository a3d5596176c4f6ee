//! Turns tracklets into tracks, after the last frame.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use roadplane_base::{FrameStamp, GroundPose, Shape, VehicleClass, angle_difference, bbox_iou};

use crate::{
    BoxSighting, ExpectedVehicle, Looks, Placed, Track, TrackOptions, TrackState,
    begin::begin,
    by_boxes::Body,
    duplicates::{merge_duplicates, merge_smoothed},
    extend::{BoxesByFrame, extend},
    link::link,
    measurement::{Sighting, Size},
    raw_track::RawTrack,
    smooth::smooth_track,
    smooth_boxes::smooth_by_boxes,
};

/// Centripetal acceleration that no driver demands of a car, m/s².
const MAX_SIDEWAYS: f64 = 7.0;

/// Longest gap that is bridged between tracks that weak boxes lengthened, s. Far away, their positions are too
/// uncertain for longer gaps.
const LENGTHENED_HIDDEN_S: f64 = 2.0;

/// Distance from the rear axle to the centre of a truck or bus, as a share of its length.
const HALF_WHEELBASE: f64 = 0.25;

/// Knowledge of the scene, beyond the detections. It validates tracks and converts between boxes and poses.
pub trait Scene {
    /// Returns the existence interval of a track: the times (s) between which it is a vehicle. Detections outside the
    /// interval are removed. `None` means that the track is no vehicle.
    fn vehicle_s(&self, track: &Track) -> Option<[f64; 2]>;

    /// Returns the size of vehicles of a class, with this shape for cars; `None` without a model of bodies.
    fn size(&self, _class: VehicleClass, _shape: &Shape) -> Option<Size> {
        None
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

    /// Returns the pose and size that a vehicle would have if a box of this frame were its own.
    fn place(&self, stamp: &FrameStamp, seen: &BoxSighting, vehicle: &ExpectedVehicle) -> Option<Placed>;
}

/// A scene without knowledge: every track counts as a vehicle, and boxes give no poses.
impl Scene for () {
    fn vehicle_s(&self, _: &Track) -> Option<[f64; 2]> {
        Some([f64::NEG_INFINITY, f64::INFINITY])
    }

    fn place(&self, _: &FrameStamp, _: &BoxSighting, _: &ExpectedVehicle) -> Option<Placed> {
        None
    }
}

/// The frames that a tracker was given, in the order of time.
#[derive(Default)]
pub(crate) struct Frames {
    /// Index and time of each frame.
    pub stamps: Vec<FrameStamp>,
    /// Time of each frame since the first, s. So the clock at the start of a clip cannot change any digit.
    pub times_s: Vec<f64>,
    /// Whether each frame is an inference frame.
    pub looked: Vec<bool>,
}

impl Frames {
    /// Adds a frame. Returns its index and its time since the first frame, s.
    pub(crate) fn push(&mut self, stamp: FrameStamp, looked: bool) -> (usize, f64) {
        self.stamps.push(stamp);
        let since_first = stamp.pts_nanos.saturating_sub(self.stamps[0].pts_nanos);
        let time_s = since_first as f64 * 1e-9;
        self.times_s.push(time_s);
        self.looked.push(looked);
        (self.stamps.len() - 1, time_s)
    }
}

/// Returns all tracks, ordered by first frame and then by x. Weak boxes come last, after the tracks without them were
/// validated. They lengthen these tracks and start others, which may be parts of one vehicle.
pub(crate) fn complete(
    tracklets: Vec<RawTrack>,
    mut free: BoxesByFrame,
    frames: &Frames,
    looks: Looks,
    options: &TrackOptions,
    scene: &impl Scene,
) -> Vec<Track> {
    let of = |track: &RawTrack| {
        let mut options = options.clone();
        if let Some(dims_m) = track.dims_m() {
            let half_wheelbase_m = HALF_WHEELBASE * dims_m.x;
            // The wheels turn by the same angles, which makes a long vehicle's path less curved.
            let bend = options.half_wheelbase_m / half_wheelbase_m;
            options.curvature_sd *= bend;
            options.curvature_change *= bend;
            options.half_wheelbase_m = half_wheelbase_m;
        }
        options
    };
    let smooth =
        |track: &RawTrack| smooth_track(&track.observations, &frames.stamps, &frames.times_s, &of(track));
    let least = options.min_observed.min(looks.count.div_ceil(2));
    let mut raw = merge_duplicates(link(merge_duplicates(tracklets), options.max_hidden_s));
    raw.retain(|track| is_seen_enough(track, least, frames, options));
    let mut whole = believed(merge_smoothed(raw, smooth), frames, scene, smooth);
    if !free.is_empty() {
        let mut raw: Vec<RawTrack> = whole.into_iter().map(|(raw, _)| raw).collect();
        leave_out(&mut free, &raw);
        for (lengthened, sure) in extend(&mut raw, &mut free, frames, options, scene) {
            keep_drivable(&mut raw[lengthened], sure, smooth);
        }
        raw.extend(begin(&free, &raw, frames, scene));
        whole = merge_smoothed(link(raw, LENGTHENED_HIDDEN_S.min(options.max_hidden_s)), smooth);
    }
    let finished = |(raw, states): (RawTrack, Vec<TrackState>)| {
        let track = smoothed(&raw, states);
        let size = scene.size(track.class, &track.shape.mean);
        let by_boxes = size.and_then(|size| {
            let body = Body { class: track.class, known: size, start_m: track.dims_m.unwrap_or(size.dims_m) };
            smooth_by_boxes(&raw.observations, &frames.stamps, &frames.times_s, &of(&raw), &body, scene)
        });
        match by_boxes {
            Some((states, size)) => Track {
                dims_m: track.dims_m.map(|_| size.dims_m),
                dims_covariance: track.dims_m.map(|_| size.covariance),
                states,
                ..track
            },
            None => track,
        }
    };
    let mut tracks: Vec<Track> = whole.into_iter().map(finished).collect();
    tracks.retain(|track| !track.states.is_empty());
    let key = |track: &Track| track.states.first().map(|s| (s.stamp.index, s.pose.x_m, s.pose.y_m));
    tracks.sort_by(|a, b| match (key(a), key(b)) {
        (Some(a), Some(b)) => a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)),
        (a, b) => a.is_some().cmp(&b.is_some()),
    });
    for (id, track) in (1..).zip(&mut tracks) {
        track.id = id;
    }
    tracks
}

/// Whether a track was detected in enough frames. The inference frames of its life count, and those in which it was
/// carried over.
fn is_seen_enough(track: &RawTrack, least: usize, frames: &Frames, options: &TrackOptions) -> bool {
    let seen = Looks::of(track.observations.iter().map(|o| o.time_s));
    let (mut life, mut next) = (Looks::default(), 0);
    for o in &track.observations {
        let between = next.max(track.observations[0].frame)..o.frame;
        between.filter(|&frame| frames.looked[frame]).for_each(|frame| {
            life.add(frames.times_s[frame]);
        });
        life.add(o.time_s);
        next = o.frame + 1;
    }
    let dense = seen.count as f64 >= options.min_duty * life.count as f64;
    track.observations.len() >= least && (dense || is_coherent(&track.observations))
}

/// Validates tracks: keeps those that are vehicles, within their existence intervals. Returns them with their states.
fn believed(
    tracks: Vec<(RawTrack, Vec<TrackState>)>,
    frames: &Frames,
    scene: &impl Scene,
    smooth: impl Fn(&RawTrack) -> Vec<TrackState>,
) -> Vec<(RawTrack, Vec<TrackState>)> {
    let of_vehicle = |(mut raw, states): (RawTrack, Vec<TrackState>)| {
        let track = smoothed(&raw, states);
        let [from_s, to_s] = scene.vehicle_s(&track)?;
        let all = raw.observations.len();
        raw.observations.retain(|o| (from_s..=to_s).contains(&frames.stamps[o.frame].time_s()));
        let states = if raw.observations.len() < all { smooth(&raw) } else { track.states };
        (!states.is_empty()).then_some((raw, states))
    };
    tracks.into_iter().filter_map(of_vehicle).collect()
}

/// Removes the parts of a lengthened track that no vehicle can drive, outside the frames `sure`. Weak boxes are
/// everywhere in a crowd and may mislead.
fn keep_drivable(track: &mut RawTrack, sure: [usize; 2], smooth: impl Fn(&RawTrack) -> Vec<TrackState>) {
    while let Some(first) = track.observations.first()
        && let Some([from, to]) = drivable(&smooth(track), first.frame, sure)
    {
        track.observations.retain(|o| (from..=to).contains(&o.frame));
    }
}

/// Removes the boxes that tracks have already.
fn leave_out(free: &mut BoxesByFrame, tracks: &[RawTrack]) {
    let seen = tracks.iter().flat_map(|track| &track.observations);
    let owned: BTreeSet<(usize, usize)> = seen.filter_map(|seen| Some((seen.frame, seen.car?))).collect();
    for (frame, boxes) in free {
        boxes.retain(|seen| seen.car.is_none_or(|car| !owned.contains(&(*frame, car))));
    }
}

/// Returns the frames between which the motion is drivable, if it is not drivable everywhere outside the frames `sure`.
/// `first` is the frame of the first state, and each frame has one state.
fn drivable(states: &[TrackState], first: usize, sure: [usize; 2]) -> Option<[usize; 2]> {
    let whole = [first, first + states.len().saturating_sub(1)];
    let mut kept = whole;
    for (i, pair) in states.windows(2).enumerate() {
        let seconds = pair[1].stamp.time_s() - pair[0].stamp.time_s();
        let turned = angle_difference(pair[1].pose.heading_rad, pair[0].pose.heading_rad).abs();
        let sideways = turned * (pair[0].speed_mps + pair[1].speed_mps).abs() / 2.0;
        if sideways <= MAX_SIDEWAYS * seconds {
            continue;
        }
        let [before, after] = [first + i, first + i + 1];
        if after <= sure[0] {
            kept[0] = kept[0].max(after);
        } else if before >= sure[1] {
            kept[1] = kept[1].min(before);
        }
    }
    (kept != whole).then_some(kept)
}

/// Returns a track with these states. Its number is not set yet.
fn smoothed(raw: &RawTrack, states: Vec<TrackState>) -> Track {
    Track {
        id: 0,
        class: raw.class(),
        dims_m: raw.dims_m(),
        dims_covariance: None,
        states,
        shape: raw.shape.fused(),
    }
}

/// Whether the box mostly stays in its position from one detection to the next. That of a parked car does, even if it
/// is often hidden. Chains of false alarms jump.
fn is_coherent(sightings: &[Sighting]) -> bool {
    let stays =
        sightings.windows(2).filter(|pair| bbox_iou(&pair[0].bbox_px, &pair[1].bbox_px) > 0.3).count();
    2 * stays + 1 > sightings.len()
}
