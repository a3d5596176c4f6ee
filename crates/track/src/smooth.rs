//! Turns the detections of a track into its smoothed states.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Matrix5, Vector3};
use roadplane_base::{FrameStamp, GroundPose, wrap_angle};

use crate::{
    TrackState,
    measurement::Sighting,
    vehicle::{State, origin},
    way::{Place, Way},
};

/// Returns one state for every frame from the first detection to the last.
pub(crate) fn smooth_track(
    sightings: &[Sighting],
    stamps: &[FrameStamp],
    times_s: &[f64],
    half_wheelbase_m: f64,
) -> Vec<TrackState> {
    let Some(way) = Way::by_poses(sightings, times_s, half_wheelbase_m) else { return Vec::new() };
    way.states(sightings, stamps, |place| place.bias(sightings, way.noise))
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
            let mut smoothed = Smoothed::new(place, state, covariance, &bias(place), self.half_wheelbase_m);
            if !self.facing.known {
                // Either end may be the front.
                smoothed.pose_sd.z = smoothed.pose_sd.z.hypot(FRAC_PI_2);
            }
            for frame in place.frames.clone() {
                let own = &sightings[place.sightings.clone()];
                let seen = own.binary_search_by_key(&frame, |o| o.frame).ok().map(|i| &own[i]);
                result.push(smoothed.at(stamps[frame], seen));
            }
        }
        result
    }
}

/// The state of a node in the form that a track reports.
struct Smoothed {
    /// Smoothed pose of the car's origin.
    pose: GroundPose,
    /// Sd of x, y (m) and heading (rad).
    pose_sd: Vector3<f64>,
    /// Speed along the heading, m/s.
    speed_mps: f64,
    /// Sd of the speed, m/s.
    speed_sd_mps: f64,
}

impl Smoothed {
    /// Converts a node's state (rear axle) and its covariance. The covariance of the pose is that of the state plus
    /// `bias`.
    fn new(
        place: &Place,
        state: &State,
        covariance: &Matrix5<f64>,
        bias: &Matrix3<f64>,
        half_wheelbase_m: f64,
    ) -> Self {
        let (pose, jacobian) = origin(state, half_wheelbase_m);
        let white = jacobian * covariance * jacobian.transpose();
        let total: Matrix3<f64> = white + bias;
        let standing = place.stand.is_some();
        Self {
            pose: GroundPose { x_m: pose.x, y_m: pose.y, heading_rad: wrap_angle(pose.z) },
            pose_sd: total.diagonal().map(|variance| variance.max(0.0).sqrt()),
            speed_mps: if standing { 0.0 } else { state[3] },
            speed_sd_mps: covariance[(3, 3)].max(0.0).sqrt(),
        }
    }

    /// Returns the track's state at a frame, with the detection in that frame, if there is one.
    fn at(&self, stamp: FrameStamp, seen: Option<&Sighting>) -> TrackState {
        TrackState {
            stamp,
            observed: seen.is_some(),
            pose: self.pose,
            pose_sd: self.pose_sd,
            speed_mps: self.speed_mps,
            speed_sd_mps: self.speed_sd_mps,
            bbox_px: seen.map(|o| o.bbox_px),
            score: seen.map_or(0.0, |o| o.score),
            car: seen.and_then(|o| o.car),
        }
    }
}
