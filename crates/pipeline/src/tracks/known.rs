//! What a first pass over the frames tells the second.

use std::collections::BTreeMap;
use std::sync::Arc;

use roadplane_base::{CarRef, GroundPose, ShapeAtlas, VehicleClass};
use roadplane_track::{ShapeBelief, Track, TrackState};

use crate::tracks::body::{Body, body_of, car_body};
use crate::tracks::stretch::sightings;

/// The vehicle in a box, as a first pass found it out.
pub(crate) struct KnownCar {
    pub vehicle: Arc<KnownVehicle>,
    pub pose: GroundPose,
    pub heading_sd_rad: f64,
}

/// The same for all its boxes.
pub(crate) struct KnownVehicle {
    pub shape: ShapeBelief,
    pub body: Body,
    pub class: VehicleClass,
}

/// Per tracked car and frame its track's shape, within the atlas' bounds, and its smoothed pose.
pub(crate) fn known_cars(tracks: &[Track], atlas: &ShapeAtlas) -> BTreeMap<CarRef, KnownCar> {
    let mut known = BTreeMap::new();
    for track in tracks {
        let shape = ShapeBelief { mean: atlas.clamped(&track.shape.mean), ..track.shape };
        let body = match track.dims_m {
            Some(dims_m) => {
                let class = body_of(track.class);
                Body { dims_m, covariance: track.dims_covariance.unwrap_or(class.covariance), ..class }
            }
            None => car_body(atlas, &track.shape.mean),
        }
        .at_best();
        let vehicle = Arc::new(KnownVehicle { shape, body, class: track.class });
        let of = |state: &TrackState| KnownCar {
            vehicle: Arc::clone(&vehicle),
            pose: state.pose,
            heading_sd_rad: state.pose_sd.z,
        };
        known.extend(sightings(track).map(|(key, state)| (key, of(state))));
    }
    known
}
