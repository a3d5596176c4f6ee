//! Turns the detections of a track into its smoothed states.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Matrix3;
use roadplane_base::{FrameStamp, GroundPose, wrap_angle};

use crate::{
    TrackState,
    frames::Frames,
    measurement::Sighting,
    raw_track::RawTrack,
    vehicle::origin,
    way::{Place, Way},
};

/// Returns one state for every frame from the first detection to the last.
pub(crate) fn smooth_track(track: &RawTrack, frames: &Frames) -> Vec<TrackState> {
    let Some(way) = Way::by_poses(track, &frames.times_s) else { return Vec::new() };
    way.states(&track.observations, &frames.stamps, |place| place.bias(&track.observations, way.noise))
}

impl Way {
    /// Returns one state for every frame. `bias` returns the covariance of the errors that the states of a node share.
    /// The node's own covariance leaves these errors out.
    pub(crate) fn states(
        &self,
        sightings: &[Sighting],
        stamps: &[FrameStamp],
        bias: impl Fn(&Place) -> Matrix3<f64>,
    ) -> Vec<TrackState> {
        let mut result = Vec::new();
        for ((place, state), covariance) in self.places.iter().zip(&self.nodes).zip(&self.covariances) {
            let (pose, jacobian) = origin(state, self.half_wheelbase_m);
            let total: Matrix3<f64> = jacobian * covariance * jacobian.transpose() + bias(place);
            let mut pose_sd = total.diagonal().map(|variance| variance.max(0.0).sqrt());
            if !self.facing.known {
                // Either end may be the front.
                pose_sd.z = pose_sd.z.hypot(FRAC_PI_2);
            }
            for frame in place.frames.clone() {
                let own = &sightings[place.sightings.clone()];
                let seen = own.binary_search_by_key(&frame, |o| o.frame).ok().map(|i| own[i].detection);
                result.push(TrackState {
                    stamp: stamps[frame],
                    observed: seen.is_some(),
                    pose: GroundPose { x_m: pose.x, y_m: pose.y, heading_rad: wrap_angle(pose.z) },
                    pose_sd,
                    speed_mps: if place.stand.is_some() { 0.0 } else { state[3] },
                    speed_sd_mps: covariance[(3, 3)].max(0.0).sqrt(),
                    bbox_px: seen.map(|o| o.bbox_px),
                    score: seen.map_or(0.0, |o| o.score),
                    car: seen.and_then(|o| o.car),
                });
            }
        }
        result
    }
}
