//! Converts a clip's windows to evidence for the camera database, and adds stored evidence to a clip's windows.

use std::collections::BTreeMap;

use roadplane_base::{CameraEvidence, EVIDENCE_SCHEMA, Lens, ParkedCar, PictureMotion};
use roadplane_calibrate::{CarIdentity, Epoch, FuseOptions, WindowEstimate, condense, joins, same_vehicle};

use crate::cameras::database::{CameraHistory, compare_views};
use crate::cameras::empty_scene_view::{moved, turned};

/// Returns the evidence of the camera's last position, and the identities of its parked vehicles.
///
/// It is evidence on the camera that takes the picture of the empty scene (`scene_from_world`). `None` if the motion
/// between the world picture and that picture is no turn.
pub(crate) fn evidence_of(
    history: &CameraHistory,
    windows: &[WindowEstimate],
    position: usize,
    clip_span_s: [f64; 2],
    parked: &BTreeMap<CarIdentity, ParkedCar>,
    scene_from_world: &PictureMotion,
    options: &FuseOptions,
) -> Option<(CameraEvidence, Vec<CarIdentity>)> {
    let last: Vec<WindowEstimate> = windows.iter().filter(|w| w.position == position).cloned().collect();
    let together = condense(&last, options)
        .unwrap_or_else(|| WindowEstimate::without_cars(options, clip_span_s, position));
    let together = turned(together, scene_from_world)?;
    let used = together.cars.iter().filter(|used| used.parked);
    let in_scene = |car: &ParkedCar| moved(car.clone(), scene_from_world);
    let (cars, parked_cars): (Vec<CarIdentity>, Vec<ParkedCar>) =
        used.filter_map(|used| Some((used.car, in_scene(parked.get(&used.car)?)))).unzip();
    let said = CameraEvidence {
        schema: EVIDENCE_SCHEMA.to_owned(),
        camera: history.camera.clone(),
        clip: history.clip.clone(),
        models: history.models.clone(),
        image_size_px: options.image_size_px,
        span_s: together.span_s,
        frames: together.frames,
        params: together.params.to_vector().into(),
        information: together.joint.information.transpose().into(),
        shared: together.joint.cross.transpose().into(),
        lens: options
            .distortion_sd
            .map(|sd| (options.lens, Lens::with_distortion(sd, options.image_size_px).per_px2)),
        moving: together.cars.len() - parked_cars.len(),
        parked: parked_cars,
        place: history.place.clone(),
    };
    Some((said, cars))
}

/// Returns the epoch to which this clip belongs, and logs it. `None` where the clip begins a new epoch.
pub(crate) fn own_epoch<'a, 'b>(
    history: &CameraHistory,
    said: &CameraEvidence,
    epochs: &'b [Epoch<'a>],
    options: &FuseOptions,
) -> Option<&'b Epoch<'a>> {
    let camera = &history.camera;
    let epoch = joins(said, epochs, &compare_views, options).map(|index| &epochs[index]);
    match epoch {
        Some(epoch) => {
            tracing::info!("camera {camera}: the camera database has {} clips of it", epoch.clips.len())
        }
        None if epochs.is_empty() => {}
        None => {
            tracing::info!("camera {camera}: it was moved since its last clip, a new epoch starts");
        }
    }
    epoch
}

/// Inserts the evidence of other clips before this clip's windows of the camera's last position. `scene_from_world` maps
/// its world picture to this clip's picture of the empty scene.
///
/// Vehicles that are parked as in an earlier clip get the identity of the stored vehicle.
pub(crate) fn add_stored(
    windows: &mut Vec<WindowEstimate>,
    position: usize,
    epoch: &Epoch<'_>,
    (said, cars): (&CameraEvidence, &[CarIdentity]),
    scene_from_world: &PictureMotion,
) {
    let known = |car: &ParkedCar| epoch.vehicles.iter().find(|(_, stored)| same_vehicle(stored, car));
    let same: BTreeMap<CarIdentity, CarIdentity> = cars
        .iter()
        .zip(&said.parked)
        .filter_map(|(own, car)| Some((*own, CarIdentity::Stored(known(car)?.0))))
        .collect();
    let first = windows.iter().position(|w| w.position == position);
    let (at, from_s) = first.map_or((windows.len(), said.span_s[0]), |at| (at, windows[at].span_s[0]));
    for window in &mut windows[at..] {
        for used in &mut window.cars {
            used.car = same.get(&used.car).copied().unwrap_or(used.car);
        }
    }
    let world_from_scene = scene_from_world.inverse();
    let in_world = epoch.windows.iter().filter_map(|window| turned(window.clone(), &world_from_scene));
    let stored = in_world.map(|window| WindowEstimate { span_s: [from_s; 2], frames: 0, position, ..window });
    windows.splice(at..at, stored.collect::<Vec<_>>());
}
