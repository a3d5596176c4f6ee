//! From tracklets to tracks, once all frames were seen.

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

/// Acceleration towards the middle of a bend that no driver asks of a car, m/s².
const MAX_SIDEWAYS: f64 = 7.0;

/// Tracks that weak boxes bring so near to each other, s, may be one: far off their places say too little for more.
const LENGTHENED_HIDDEN_S: f64 = 2.0;

/// Rear axle to the middle of a truck or bus, as a share of its length.
const HALF_WHEELBASE: f64 = 0.25;

/// What tracks are held against, beyond what sightings say of themselves.
pub trait Scene {
    /// From when to when a track is of a vehicle, s; what it has before and after is left out, and all of it where it is of none.
    fn vehicle_s(&self, track: &Track) -> Option<[f64; 2]>;

    /// How large vehicles of a class are, cars those of this shape; `None` where nothing is known of bodies.
    fn size(&self, _class: VehicleClass, _shape: &Shape) -> Option<Size> {
        None
    }

    /// The box in which such a vehicle would be seen, px; `None` where it is not before the camera.
    fn body_px(
        &self,
        _stamp: &FrameStamp,
        _pose: &GroundPose,
        _class: VehicleClass,
        _dims_m: &Vector3<f64>,
    ) -> Option<[f64; 4]> {
        None
    }

    /// Where a vehicle would stand if a box of this frame were its own.
    fn place(&self, stamp: &FrameStamp, seen: &BoxSighting, vehicle: &ExpectedVehicle) -> Option<Placed>;
}

/// Nothing is known of the scene: all tracks are taken for vehicles, and boxes for nothing.
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
    pub stamps: Vec<FrameStamp>,
    /// From the first frame on: what a clock says at the start of a clip must not change a digit.
    pub times_s: Vec<f64>,
    /// Which of them were looked at.
    pub looked: Vec<bool>,
}

impl Frames {
    /// Number and time of the next one.
    pub(crate) fn push(&mut self, stamp: FrameStamp, looked: bool) -> (usize, f64) {
        self.stamps.push(stamp);
        let since_first = stamp.pts_nanos.saturating_sub(self.stamps[0].pts_nanos);
        let time_s = since_first as f64 * 1e-9;
        self.times_s.push(time_s);
        self.looked.push(looked);
        (self.stamps.len() - 1, time_s)
    }
}

/// All tracks, by first frame, then by x. Weak boxes come last, once it is known which tracks need none to be believed: they lengthen those,
/// and begin others, which may be parts of one vehicle.
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
            // Wheels are turned alike, which bends a long vehicle's way less.
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

/// Whether a track was seen in enough of the frames in which it could have been: those that were looked at, and where it was held.
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

/// Tracks that are of vehicles, for as long as they are, with their states.
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

/// Takes from a track that was lengthened beyond the frames that are sure what no vehicle can drive: weak boxes lie everywhere in a crowd
/// and lead astray.
fn keep_drivable(track: &mut RawTrack, sure: [usize; 2], smooth: impl Fn(&RawTrack) -> Vec<TrackState>) {
    while let Some(first) = track.observations.first()
        && let Some([from, to]) = drivable(&smooth(track), first.frame, sure)
    {
        track.observations.retain(|o| (from..=to).contains(&o.frame));
    }
}

/// Boxes that tracks have are nobody else's.
fn leave_out(free: &mut BoxesByFrame, tracks: &[RawTrack]) {
    let seen = tracks.iter().flat_map(|track| &track.observations);
    let owned: BTreeSet<(usize, usize)> = seen.filter_map(|seen| Some((seen.frame, seen.car?))).collect();
    for (frame, boxes) in free {
        boxes.retain(|seen| seen.car.is_none_or(|car| !owned.contains(&(*frame, car))));
    }
}

/// If a vehicle cannot go like this beyond the frames that are sure: from which to which frame it can. States begin with `first`, one a
/// frame.
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

/// Whether the box is mostly where it was at the sighting before, as of a parked car that is often hidden; false alarms
/// strung together jump.
fn is_coherent(sightings: &[Sighting]) -> bool {
    let stays =
        sightings.windows(2).filter(|pair| bbox_iou(&pair[0].bbox_px, &pair[1].bbox_px) > 0.3).count();
    2 * stays + 1 > sightings.len()
}
