//! Converts a clip's windows to evidence for the camera database, and adds stored evidence to a clip's windows.

use std::collections::BTreeMap;

use roadplane_base::{CameraEvidence, EVIDENCE_SCHEMA, Lens, ParkedCar};
use roadplane_calibrate::{CarIdentity, Epoch, FuseOptions, WindowEstimate, condense, joins, same_vehicle};

use crate::cameras::empty_scene_view::EmptySceneView;
use crate::cameras::memory::{CameraHistory, look};

/// Returns the evidence of the camera's last position, and the identities of its parked vehicles.
///
/// It is evidence on the camera that takes the picture of the empty scene (`view`). `None` where the picture shows
/// another position.
pub(crate) fn evidence_of(
    recall: &CameraHistory,
    windows: &[WindowEstimate],
    position: usize,
    clip_span_s: [f64; 2],
    parked: &BTreeMap<CarIdentity, ParkedCar>,
    view: &EmptySceneView,
    options: &FuseOptions,
) -> Option<(CameraEvidence, Vec<CarIdentity>)> {
    let last: Vec<WindowEstimate> = windows.iter().filter(|w| w.segment == position).cloned().collect();
    let together = condense(&last, options)
        .unwrap_or_else(|| WindowEstimate::without_cars(options, clip_span_s, position));
    let stood = together.cars.iter().filter(|used| used.parked);
    let (cars, stood): (Vec<CarIdentity>, Vec<ParkedCar>) =
        stood.filter_map(|used| Some((used.car, parked.get(&used.car)?.clone()))).unzip();
    let params = together.params.to_vector();
    let said = CameraEvidence {
        schema: EVIDENCE_SCHEMA.to_owned(),
        camera: recall.camera.clone(),
        clip: recall.clip.clone(),
        models: recall.models.clone(),
        image_size_px: options.image_size_px,
        span_s: together.span_s,
        frames: together.frames,
        params: std::array::from_fn(|i| params[i]),
        information: std::array::from_fn(|r| std::array::from_fn(|c| together.joint.information[(r, c)])),
        shared: std::array::from_fn(|r| std::array::from_fn(|c| together.joint.cross[(r, c)])),
        lens: options
            .bend_sd
            .map(|sd| (options.lens, Lens::with_distortion(sd, options.image_size_px).per_px2)),
        moving: together.cars.len() - stood.len(),
        parked: stood,
        place: recall.place.clone(),
    };
    Some((view.evidence(said)?, cars))
}

/// Returns the epoch to which this clip belongs, and logs it. `None` where the clip begins a new epoch.
pub(crate) fn own_epoch<'a, 'b>(
    recall: &CameraHistory,
    said: &CameraEvidence,
    epochs: &'b [Epoch<'a>],
    options: &FuseOptions,
) -> Option<&'b Epoch<'a>> {
    let camera = &recall.camera;
    let epoch = joins(said, epochs, &look, options).map(|index| &epochs[index]);
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

/// Inserts the evidence of other clips before this clip's windows of the camera's last position. `view` is the view of
/// this clip's picture of the empty scene.
///
/// Vehicles that are parked as in an earlier clip get the identity of the stored vehicle.
pub(crate) fn add_remembered(
    windows: &mut Vec<WindowEstimate>,
    position: usize,
    epoch: &Epoch<'_>,
    (said, cars): (&CameraEvidence, &[CarIdentity]),
    view: &EmptySceneView,
) {
    let known = |car: &ParkedCar| epoch.vehicles.iter().find(|(_, known)| same_vehicle(known, car));
    let same: BTreeMap<CarIdentity, CarIdentity> = cars
        .iter()
        .zip(&said.parked)
        .filter_map(|(own, car)| Some((*own, CarIdentity::Stored(known(car)?.0))))
        .collect();
    let first = windows.iter().position(|w| w.segment == position);
    let (at, from_s) = first.map_or((windows.len(), said.span_s[0]), |at| (at, windows[at].span_s[0]));
    for window in &mut windows[at..] {
        for used in &mut window.cars {
            used.car = same.get(&used.car).copied().unwrap_or(used.car);
        }
    }
    let in_world = epoch.windows.iter().filter_map(|window| view.window_in_world(window));
    let remembered =
        in_world.map(|window| WindowEstimate { span_s: [from_s; 2], frames: 0, segment: position, ..window });
    windows.splice(at..at, remembered.collect::<Vec<_>>());
}
