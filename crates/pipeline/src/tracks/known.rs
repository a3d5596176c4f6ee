//! The results of the first pass over the frames that the second pass uses.

use std::collections::BTreeMap;
use std::sync::Arc;

use roadplane_base::{CarRef, GroundPose, ShapeAtlas, VehicleClass};
use roadplane_measure::{Body, body_of, car_body};
use roadplane_track::{ShapeEstimate, Track, TrackState};

/// The vehicle in a box, from the first pass.
pub(crate) struct TrackedCar {
    /// The vehicle, common to all its boxes.
    pub vehicle: Arc<TrackedVehicle>,
    /// Smoothed pose at this frame.
    pub pose: GroundPose,
    /// Sd of the heading, rad.
    pub heading_sd_rad: f64,
}

/// A vehicle from the first pass, common to all its boxes.
pub(crate) struct TrackedVehicle {
    /// Mean and information of its shape.
    pub shape: ShapeEstimate,
    /// Its class and size.
    pub body: Body,
}

/// Returns the track's shape and smoothed pose for each detection of a track. Shapes are within the atlas's bounds.
pub(crate) fn tracked_cars(tracks: &[Track], atlas: &ShapeAtlas) -> BTreeMap<CarRef, TrackedCar> {
    let mut cars = BTreeMap::new();
    for track in tracks {
        let shape = ShapeEstimate { mean: atlas.clamped(&track.shape.mean), ..track.shape };
        let body = match track.dims_m {
            Some(dims_m) => {
                let class = body_of(track.class);
                Body { dims_m, covariance: track.dims_covariance.unwrap_or(class.covariance), ..class }
            }
            None if track.class == VehicleClass::Car => car_body(atlas, &track.shape.mean),
            None => body_of(track.class),
        }
        .at_best();
        let vehicle = Arc::new(TrackedVehicle { shape, body });
        let of = |state: &TrackState| TrackedCar {
            vehicle: Arc::clone(&vehicle),
            pose: state.pose,
            heading_sd_rad: state.pose_sd.z,
        };
        cars.extend(track.measured().map(|(key, state)| (key, of(state))));
    }
    cars
}
