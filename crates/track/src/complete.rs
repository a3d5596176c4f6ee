//! Turns tracklets into tracks, after the last frame.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use roadplane_base::{FrameStamp, GroundPose, Shape, VehicleClass, angle_difference};

use crate::{
    BoxSighting, Evidence, ExpectedVehicle, Placed, Track, TrackOptions, TrackState,
    begin::begin,
    by_boxes::Body,
    duplicates::{merge_duplicates, merge_smoothed},
    extend::{BoxesByFrame, extend},
    link::link,
    looks::Looks,
    measurement::Size,
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

/// Knowledge of the scene, beyond the detections. It converts between boxes and poses.
pub trait Scene {
    /// Returns the size of vehicles of a class, with this shape for cars; `None` without a model of bodies.
    fn size(&self, _class: VehicleClass, _shape: &Shape) -> Option<Size> {
        None
    }

    /// Returns length, width and height of the site's mean car, m; `None` without a model of bodies.
    fn mean_car(&self) -> Option<Vector3<f64>> {
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

/// A scene without knowledge: boxes give no poses.
impl Scene for () {
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

    /// Returns the number of inference frames that are far enough apart in time.
    fn looks(&self) -> usize {
        let looked = self.times_s.iter().zip(&self.looked).filter(|(_, looked)| **looked);
        Looks::of(looked.map(|(time_s, _)| *time_s)).count
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

/// Returns all tracks that are probably vehicles. Weak boxes come last. They lengthen the tracks that exist without them,
/// and start others, which may be parts of one vehicle.
pub(crate) fn complete(
    tracklets: Vec<RawTrack>,
    mut free: BoxesByFrame,
    frames: &Frames,
    options: &TrackOptions,
    scene: &impl Scene,
) -> Tracks {
    let steps = options.steps;
    let least = options.min_observed.min(frames.looks().div_ceil(2));
    let mut completion = Completion { frames, options, scene, least, left_out: Vec::new() };
    let linked = completion.linked(completion.merged(tracklets), options.max_hidden_s);
    let raw = completion.merged(linked).into_iter().filter(|raw| raw.observations.len() >= least);
    let (mut whole, others): (Vec<_>, Vec<_>) = (completion.smoothed(raw.collect()).into_iter())
        .partition(|(raw, states)| completion.exists(raw, states));
    if !free.is_empty() {
        // The boxes of another object are explained, too.
        leave_out(&mut free, others.iter().chain(&whole).map(|(raw, _)| raw));
        let mut raw: Vec<RawTrack> = whole.into_iter().map(|(raw, _)| raw).collect();
        if steps.extend {
            for (lengthened, sure) in extend(&mut raw, &mut free, frames, options, scene) {
                if steps.drivable {
                    keep_drivable(&mut raw[lengthened], sure, |track| completion.smooth(track));
                }
            }
        }
        if steps.begin {
            let mut begun = begin(&free, &raw, frames, scene);
            begun.retain(|raw| completion.exists(raw, &completion.smooth(raw)));
            raw.extend(begun);
        }
        whole = completion.smoothed(completion.linked(raw, LENGTHENED_HIDDEN_S.min(options.max_hidden_s)));
        whole.retain(|(raw, states)| completion.exists(raw, states));
    }
    let mut tracks: Vec<Track> =
        whole.into_iter().filter_map(|(raw, states)| completion.finished(&raw, states)).collect();
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
    /// Merges tracks of one vehicle, by single detections.
    fn merged(&self, tracks: Vec<RawTrack>) -> Vec<RawTrack> {
        if self.options.steps.merge { merge_duplicates(tracks) } else { tracks }
    }

    /// Links tracks over gaps of up to `horizon_s`, s.
    fn linked(&self, tracks: Vec<RawTrack>, horizon_s: f64) -> Vec<RawTrack> {
        if self.options.steps.link { link(tracks, horizon_s) } else { tracks }
    }

    /// Smooths tracks, and merges those of one vehicle by their smoothed poses. Returns them with their states.
    fn smoothed(&self, tracks: Vec<RawTrack>) -> Vec<(RawTrack, Vec<TrackState>)> {
        if self.options.steps.merge {
            return merge_smoothed(tracks, |track| self.smooth(track));
        }
        let with_states = |track: RawTrack| {
            let states = self.smooth(&track);
            (track, states)
        };
        tracks.into_iter().map(with_states).collect()
    }

    /// Returns the smoothed states of a track.
    fn smooth(&self, track: &RawTrack) -> Vec<TrackState> {
        let Frames { stamps, times_s, .. } = self.frames;
        smooth_track(&track.observations, stamps, times_s, &self.options_of(track))
    }

    /// Returns the settings for a vehicle of this size. The wheels of all vehicles turn by the same angles, which makes a
    /// long vehicle's path less curved.
    fn options_of(&self, track: &RawTrack) -> TrackOptions {
        let mut options = self.options.clone();
        if let Some(dims_m) = track.dims_m() {
            let half_wheelbase_m = HALF_WHEELBASE * dims_m.x;
            let bend = options.half_wheelbase_m / half_wheelbase_m;
            options.curvature_sd *= bend;
            options.curvature_change *= bend;
            options.half_wheelbase_m = half_wheelbase_m;
        }
        options
    }

    /// Collects what shows whether a track is a vehicle; `None` without a detection.
    fn evidence(&self, raw: &RawTrack, states: &[TrackState]) -> Option<Evidence> {
        let (class, shape) = (raw.class(), raw.shape.fused().mean);
        let dims_m = raw.dims_m().or_else(|| Some(self.scene.size(class, &shape)?.dims_m));
        let above_car_m = dims_m.zip(self.scene.mean_car()).map_or(0.0, |(dims_m, car_m)| dims_m.z - car_m.z);
        Evidence::of(&raw.observations, states, class, above_car_m)
    }

    /// Whether a track has enough detections and is probably a vehicle. If it is none, it is listed as left out.
    fn exists(&mut self, raw: &RawTrack, states: &[TrackState]) -> bool {
        if raw.observations.len() < self.least {
            return false;
        }
        let is_vehicle = |evidence: Evidence| evidence.probability() >= self.options.min_exists_p;
        let exists = !self.options.steps.existence || self.evidence(raw, states).is_some_and(is_vehicle);
        if !exists {
            self.left_out.extend(states.first().map(|state| state.stamp));
        }
        exists
    }

    /// Returns the finished track. Where only boxes show the vehicle, they give its path and its size together.
    fn finished(&self, raw: &RawTrack, states: Vec<TrackState>) -> Option<Track> {
        let evidence = self.evidence(raw, &states)?;
        let (class, dims_m, shape) = (raw.class(), raw.dims_m(), raw.shape.fused());
        let track = Track { id: 0, class, dims_m, dims_covariance: None, states, shape, evidence };
        let size = self.scene.size(class, &shape.mean).filter(|_| self.options.steps.by_boxes);
        let by_boxes = size.and_then(|size| {
            let body = Body { class, known: size, start_m: dims_m.unwrap_or(size.dims_m) };
            let Frames { stamps, times_s, .. } = self.frames;
            smooth_by_boxes(&raw.observations, stamps, times_s, &self.options_of(raw), &body, self.scene)
        });
        Some(match by_boxes {
            Some((states, size)) => Track {
                dims_m: dims_m.map(|_| size.dims_m),
                dims_covariance: dims_m.map(|_| size.covariance),
                states,
                ..track
            },
            None => track,
        })
    }
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
fn leave_out<'a>(free: &mut BoxesByFrame, tracks: impl Iterator<Item = &'a RawTrack>) {
    let seen = tracks.flat_map(|track| &track.observations);
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
