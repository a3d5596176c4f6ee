//! One pass over a stretch's frames: every car fitted, all of them followed.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Vector2, Vector3};
use roadplane_base::{
    CarRecord, CarRef, FrameRecord, FrameStamp, GroundPose, ImageSize, PoseRecord, Shape, ShapeAtlas,
    TrackRow, VehicleClass, WatchRecord, bbox_moved, bbox_part_seen, bbox_share_inside,
};
use roadplane_geo::Place;
use roadplane_solve::{CarFit, SceneOptions, ShapePrior};
use roadplane_track::{
    BoxSighting, CarMeasurement, ExpectedVehicle, FrameMeasurements, HeldCar, Placed, Scene, SeenAgain,
    ShapeBelief, Size, Track, TrackState, Tracker,
};

use crate::cameras::camera_track::CameraTrack;
use crate::tracks::believe::{is_believable, overlap_inside, picture_px, projected_box, vehicle_s};
use crate::tracks::body::{Body, body_of, car_body};
use crate::tracks::cars::{FrameCamera, HeldPoses, fit_frame, pose_record};
use crate::tracks::ground_contact::{Knowledge, body_box, cut_edges, ground_contact};
use crate::tracks::hidden::hidden_edges;
use crate::tracks::shared_error::shared_covariance;
use crate::tracks::stretch::{Stretch, sightings};
use crate::{Config, PipelineError};

/// Least overlap of the box of a row that is called observed with that of the vehicle where the row has it.
const MIN_ROW_OVERLAP: f64 = 0.3;
/// Less of an unseen vehicle's box than this is in the picture: it is not there.
const IN_VIEW_SHARE: f64 = 0.15;
/// Least sd of a track's heading for the same, rad.
const KNOWN_HEADING_SD_RAD: f64 = 0.05;
/// A heading whose sd is no less says nothing, rad.
const UNKNOWN_HEADING_SD_RAD: f64 = 1.5;

/// Counts of cars (car and frame).
#[derive(Debug, Default)]
pub struct Tally {
    /// Boxes by class.
    pub boxes: BTreeMap<String, u64>,
    /// Cars dropped, by reason.
    pub rejected: BTreeMap<String, u64>,
}

/// Offset of the picture in frames in which it was shaken, px.
pub(crate) type Shake = BTreeMap<u64, Vector2<f64>>;

/// What a pass over the frames needs.
pub(crate) struct Pass<'a> {
    pub cameras: &'a CameraTrack,
    pub place: Option<&'a Place>,
    pub atlas: &'a ShapeAtlas,
    /// What is known of a car's shape before it is looked at.
    pub any_car: ShapePrior,
    pub options: SceneOptions,
    pub config: &'a Config,
}

impl Pass<'_> {
    /// Fits all cars of all frames that the stretch sees and tracks them; cars in `known`, which an earlier pass found out, have that
    /// shape and about that pose, and only then boxes that are no vehicle's yet have a say. Gives
    /// the tracks and the shake. Poses go to the sink, and cars into the tally, of the frames that are the stretch's own.
    pub(crate) fn tracks(
        &self,
        frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
        stretch: Stretch,
        known: Option<&BTreeMap<CarRef, KnownCar>>,
        tally: &mut Tally,
        mut sink: impl FnMut(&PoseRecord) -> Result<(), PipelineError>,
    ) -> Result<(Vec<Track>, Shake), PipelineError> {
        let mut tracker = Tracker::new(self.config.track.clone());
        let mut tracks = Vec::new();
        let mut shake_px = Shake::default();
        let mut position = None;
        let mut looked_s = Vec::new();
        let mut looks = HeldPoses::default();
        for frame in frames {
            let frame = frame?;
            let own = stretch.holds(frame.time_s);
            let Some(estimate) = self.cameras.at(frame.time_s) else { continue };
            // Coordinates of one camera position mean nothing in another: tracks end where the camera was moved.
            let here = self.cameras.position_at(frame.time_s);
            if position.replace(here).is_some_and(|before| before != here) {
                let ended = std::mem::replace(&mut tracker, Tracker::new(self.config.track.clone()));
                append(&mut tracks, ended.finish(&Looked { pass: self, looked_s: &looked_s }));
            }
            if let Some(shake) =
                frame.watch.as_ref().map(WatchRecord::offset).filter(|shake| shake.norm() > 0.0)
            {
                shake_px.insert(frame.frame, shake);
            }
            let view = FrameCamera::from(estimate);
            let prior =
                |i: usize| match known.and_then(|known| known.get(&CarRef { frame: frame.frame, car: i })) {
                    Some(known) => (ShapePrior::known(known.vehicle.shape.mean), Some(known.pose)),
                    None => (self.any_car, None),
                };
            let fitted = fit_frame(&frame, &view, self.atlas, &self.options, self.config, prior);
            let (mut cars, mut held, mut seen_again, mut boxes) =
                (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            for (index, fit) in fitted.into_iter().enumerate() {
                let record = &frame.cars[index];
                if let Some(look) = record.seen_after {
                    seen_again.push(SeenAgain { look, bbox_px: record.bbox_px });
                    continue;
                }
                let seen = || box_sighting(&frame, record.bbox_px, record.score, Some(index));
                if record.held_since.is_some() || record.pose_from.is_some() {
                    held.push(held_car(record, index));
                    if let Some(pose) = looks.line(&frame, index).filter(|_| own) {
                        sink(&pose)?;
                    }
                    if record.keypoints.is_none() {
                        boxes.extend(known.map(|_| seen()));
                        continue;
                    }
                }
                let seen = seen();
                boxes.extend(known.map(|_| seen));
                let BoxSighting { cut, hidden, .. } = seen;
                let class = format!("{:?}", record.class).to_lowercase();
                *tally.boxes.entry(class).or_insert(0) += u64::from(own);
                let reason = match &fit {
                    None => Some("no_pose"),
                    Some(fit) => {
                        let car = &fit.car;
                        let projected =
                            projected_box(self.atlas, &view.camera, &car.camera_from_car, &car.shape)
                                .map(|whole| bbox_part_seen(&whole, &record.bbox_px, hidden));
                        let (rms, size) = (car.reprojection_rms_px, frame.image_size_px);
                        let believable = is_believable(projected, &record.bbox_px, rms, size, self.config);
                        (!(car.used && believable)).then_some("keypoints_disagree")
                    }
                };
                let known = known.and_then(|known| known.get(&CarRef { frame: frame.frame, car: index }));
                // The net finds a car's keypoints in a truck, too.
                let is_car = known.is_none_or(|known| known.vehicle.class == VehicleClass::Car);
                let by_keypoints = fit.as_ref().filter(|_| reason.is_none() && is_car);
                let measured = by_keypoints
                    .map(|fit| measurement(fit, record, index, self.any_car, known))
                    .or_else(|| self.by_box(record, index, &frame, hidden, &view, known));
                match measured {
                    Some(measured) => {
                        let known = known.is_some();
                        cars.push(CarMeasurement { cut, hidden, known, ..measured });
                    }
                    None => {
                        *tally.rejected.entry(reason.unwrap_or("no_pose").to_owned()).or_insert(0) +=
                            u64::from(own)
                    }
                }
                let Some(fit) = fit else { continue };
                if let Some(mut pose) = pose_record(&frame, index, &fit, self.atlas) {
                    pose.used = reason.is_none() && is_car;
                    looks.remember(&pose);
                    if own {
                        sink(&pose)?;
                    }
                }
            }
            let pts_nanos = (frame.time_s * 1e9).round() as i64;
            let stamp = FrameStamp { index: frame.frame, pts_nanos };
            let looked = frame.watch.as_ref().is_none_or(|watch| watch.looked);
            // Where something was held it counts as looked at, too.
            if looked || !held.is_empty() {
                looked_s.push(frame.time_s);
            }
            if known.is_some() {
                boxes.extend(
                    frame.weak.iter().map(|weak| box_sighting(&frame, weak.bbox_px, weak.score, None)),
                );
            }
            tracker.push(&FrameMeasurements { stamp, looked, cars, held, seen_again, boxes });
        }
        append(&mut tracks, tracker.finish(&Looked { pass: self, looked_s: &looked_s }));
        for (id, track) in (1..).zip(&mut tracks) {
            track.id = id;
        }
        Ok((tracks, shake_px))
    }

    /// The place of a vehicle of which the box says more than keypoints do.
    fn by_box(
        &self,
        record: &CarRecord,
        car: usize,
        frame: &FrameRecord,
        hidden: [bool; 4],
        view: &FrameCamera,
        known: Option<&KnownCar>,
    ) -> Option<CarMeasurement> {
        let knowledge = match known {
            Some(known) => Knowledge::Track {
                body: known.vehicle.body,
                heading_rad: known.pose.heading_rad,
                heading_sd_rad: known.heading_sd_rad.max(KNOWN_HEADING_SD_RAD),
            },
            None => Knowledge::Label(record.class),
        };
        let found = ground_contact(&record.bbox_px, frame.image_size_px, hidden, view, &knowledge)?;
        Some(CarMeasurement {
            pose: found.pose,
            covariance: found.covariance,
            bbox_px: record.bbox_px,
            score: record.score,
            class: record.class,
            shape_before: ShapeBelief::default(),
            shape: ShapeBelief::default(),
            car,
            from_box: true,
            cut: [false; 4],
            hidden: [false; 4],
            known: false,
            dims_m: Some([found.dims_m, found.dims_sd_m]),
        })
    }

    /// Box of a sighting that is where the track has its vehicle then: another one was another's.
    fn own_box(&self, state: &TrackState, projected: Option<&[f64; 4]>, size: ImageSize) -> Option<[f64; 4]> {
        let fits = |seen: &[f64; 4]| {
            projected.is_none_or(|drawn| overlap_inside(drawn, seen, size) >= MIN_ROW_OVERLAP)
        };
        state.bbox_px.filter(fits)
    }

    /// Whether most of a track's sightings are of a vehicle at its place.
    pub(crate) fn is_where_it_is_seen(&self, track: &Track) -> bool {
        let (mut own, mut sightings) = (0, 0);
        for state in track.states.iter().filter(|state| state.car.is_some()) {
            let Some(estimate) = self.cameras.at(state.stamp.time_s()) else { continue };
            let projected = self.projected_box(track, state);
            sightings += 1;
            own += usize::from(self.own_box(state, projected.as_ref(), estimate.image_size_px).is_some());
        }
        2 * own >= sightings
    }

    /// A track's rows, one for each frame in which its vehicle is in the picture; boxes are where the shaken picture has them.
    pub(crate) fn rows(&self, track: &Track, shake_px: &Shake) -> Vec<TrackRow> {
        let dims = self.dims_m(track);
        let row = |state: &TrackState| {
            let projected = self.projected_box(track, state);
            let estimate = self.cameras.at(state.stamp.time_s())?;
            let seen_px = self.own_box(state, projected.as_ref(), estimate.image_size_px);
            let picture_px = picture_px(estimate.image_size_px);
            let in_view = |drawn: &[f64; 4]| bbox_share_inside(drawn, &picture_px) >= IN_VIEW_SHARE;
            let at_rest = seen_px.or(projected.filter(in_view))?;
            let bbox_px =
                shake_px.get(&state.stamp.index).map_or(at_rest, |shake| bbox_moved(&at_rest, shake));
            // What all cars share belongs to each row, too.
            let shared = shared_covariance(estimate, &state.pose);
            let whole = |own: f64, i: usize| (own * own + shared[(i, i)]).sqrt();
            Some(TrackRow {
                frame: state.stamp.index,
                time_s: state.stamp.time_s(),
                track: track.id,
                x_m: state.pose.x_m,
                y_m: state.pose.y_m,
                heading_rad: state.pose.heading_rad,
                speed_mps: state.speed_mps,
                x_sd_m: whole(state.pose_sd.x, 0),
                y_sd_m: whole(state.pose_sd.y, 1),
                heading_sd_rad: whole(state.pose_sd.z, 2),
                length_m: dims.x,
                width_m: dims.y,
                height_m: dims.z,
                bbox_px,
                score: if seen_px.is_some() { state.score } else { 0.0 },
                observed: seen_px.is_some(),
                class: track.class,
                segment: self.cameras.segment_at(state.stamp.time_s()),
                speed_sd_mps: state.speed_sd_mps.hypot(state.speed_mps * shared[(3, 3)].sqrt()),
                activity: None,
                activity_p: None,
                x_own_sd_m: Some(state.pose_sd.x),
                y_own_sd_m: Some(state.pose_sd.y),
                on_map: self.place.and_then(|place| {
                    place.on_map(&state.pose, [state.pose_sd.x, state.pose_sd.y], estimate).ok()
                }),
            })
        };
        track.states.iter().filter_map(row).collect()
    }

    /// Box of a car that was not seen; `None` where it is not before the camera.
    fn projected_box(&self, track: &Track, state: &TrackState) -> Option<[f64; 4]> {
        let view = FrameCamera::from(self.cameras.at(state.stamp.time_s())?);
        if let Some(dims_m) = track.dims_m {
            return body_box(&view, &state.pose, track.class, &dims_m);
        }
        let camera_from_car = view.plane.camera_from_world() * state.pose.world_from_car();
        projected_box(self.atlas, &view.camera, &camera_from_car, &track.shape.mean)
    }

    /// Length, width, height of a track's vehicle.
    fn dims_m(&self, track: &Track) -> Vector3<f64> {
        track.dims_m.unwrap_or_else(|| self.atlas.dims_m(&self.atlas.clamped(&track.shape.mean)))
    }
}

/// What tracks are held against.
struct Looked<'a> {
    pass: &'a Pass<'a>,
    looked_s: &'a [f64],
}

impl Scene for Looked<'_> {
    fn vehicle_s(&self, track: &Track) -> Option<[f64; 2]> {
        vehicle_s(track, self.pass.dims_m(track).z, self.looked_s)
    }

    fn size(&self, class: VehicleClass, shape: &Shape) -> Option<Size> {
        let body = match class {
            VehicleClass::Car => car_body(self.pass.atlas, shape).at_best(),
            class => body_of(class),
        };
        Some(Size { dims_m: body.dims_m, covariance: body.covariance })
    }

    fn body_px(
        &self,
        stamp: &FrameStamp,
        pose: &GroundPose,
        class: VehicleClass,
        dims_m: &Vector3<f64>,
    ) -> Option<[f64; 4]> {
        body_box(&FrameCamera::from(self.pass.cameras.at(stamp.time_s())?), pose, class, dims_m)
    }

    fn place(&self, stamp: &FrameStamp, seen: &BoxSighting, vehicle: &ExpectedVehicle) -> Option<Placed> {
        let Pass { cameras, atlas, .. } = self.pass;
        let estimate = cameras.at(stamp.time_s())?;
        let dims_m = vehicle.dims_m.unwrap_or_else(|| atlas.dims_m(&atlas.clamped(&vehicle.shape)));
        let knowledge = match vehicle.heading_sd_rad < UNKNOWN_HEADING_SD_RAD {
            true => Knowledge::Track {
                body: Body { dims_m, ..body_of(vehicle.class) },
                heading_rad: vehicle.heading_rad,
                heading_sd_rad: vehicle.heading_sd_rad.max(KNOWN_HEADING_SD_RAD),
            },
            false => Knowledge::Label(vehicle.class),
        };
        let (size, view) = (estimate.image_size_px, FrameCamera::from(estimate));
        let found = ground_contact(&seen.bbox_px, size, seen.hidden, &view, &knowledge)?;
        Some(Placed {
            pose: found.pose,
            covariance: found.covariance,
            dims_m: [found.dims_m, found.dims_sd_m],
        })
    }
}

/// Adds tracks of a later camera position; their numbers go on.
fn append(tracks: &mut Vec<Track>, later: Vec<Track>) {
    let before = tracks.iter().map(|track| track.id).max().unwrap_or(0);
    tracks.extend(later.into_iter().map(|track| Track { id: track.id + before, ..track }));
}

/// What keypoints say of a car; the shape of a known one was held.
fn measurement(
    fit: &CarFit,
    record: &CarRecord,
    car: usize,
    any_car: ShapePrior,
    known: Option<&KnownCar>,
) -> CarMeasurement {
    let (shape_before, shape) = match known {
        Some(known) => (known.vehicle.shape, known.vehicle.shape),
        None => {
            let before = ShapeBelief { mean: any_car.mean, information: any_car.information };
            let after = |information| ShapeBelief { mean: fit.car.shape, information };
            (before, fit.car.shape_covariance.try_inverse().map_or(before, after))
        }
    };
    CarMeasurement {
        pose: fit.car.ground,
        covariance: fit.car.ground_covariance,
        bbox_px: record.bbox_px,
        score: record.score,
        class: VehicleClass::Car,
        shape_before,
        shape,
        car,
        from_box: false,
        cut: [false; 4],
        hidden: [false; 4],
        known: false,
        dims_m: None,
    }
}

/// A box of a frame, in its list of cars or beside it, that may be a vehicle.
fn box_sighting(frame: &FrameRecord, bbox_px: [f64; 4], score: f64, car: Option<usize>) -> BoxSighting {
    let class = car.map_or(VehicleClass::Car, |car| frame.cars[car].class);
    let others = frame.cars.iter().enumerate().filter(|(other, _)| Some(*other) != car);
    let hidden = hidden_edges(&bbox_px, others.map(|(_, other)| &other.bbox_px));
    BoxSighting { bbox_px, score, class, cut: cut_edges(&bbox_px, frame.image_size_px), hidden, car }
}

/// A vehicle that is where it was.
fn held_car(record: &CarRecord, car: usize) -> HeldCar {
    HeldCar { look: record.pose_from, bbox_px: record.bbox_px, score: record.score, car }
}

/// What a first pass over the frames tells the second of the vehicle in a box.
pub(crate) struct KnownCar {
    pub vehicle: Arc<KnownVehicle>,
    pose: GroundPose,
    heading_sd_rad: f64,
}

/// The same for all its boxes.
pub(crate) struct KnownVehicle {
    pub shape: ShapeBelief,
    body: Body,
    class: VehicleClass,
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
