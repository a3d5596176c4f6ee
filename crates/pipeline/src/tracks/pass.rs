//! One pass over a stretch's frames: every car fitted, all of them followed.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::{
    CarRecord, CarRef, FrameRecord, FrameStamp, PoseRecord, ShapeAtlas, VehicleClass, WatchRecord,
    bbox_part_seen,
};
use roadplane_geo::Place;
use roadplane_solve::{CarFit, SceneOptions, ShapePrior};
use roadplane_track::{
    BoxSighting, CarMeasurement, FrameMeasurements, HeldCar, SeenAgain, ShapeBelief, Track, Tracker,
};

use crate::cameras::camera_track::CameraTrack;
use crate::tracks::believe::{is_believable, projected_box};
use crate::tracks::cars::{FrameCamera, HeldPoses, fit_frame, pose_record};
use crate::tracks::ground_contact::{Knowledge, cut_edges, ground_contact};
use crate::tracks::hidden::hidden_edges;
use crate::tracks::known::KnownCar;
use crate::tracks::scene::Looked;
use crate::tracks::stretch::Stretch;
use crate::{Config, PipelineError};

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
                heading_sd_rad: known.heading_sd_rad,
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
    let held = car.is_some_and(|car| frame.cars[car].held_since.is_some());
    BoxSighting { bbox_px, score, class, cut: cut_edges(&bbox_px, frame.image_size_px), hidden, car, held }
}

/// A vehicle that is where it was.
fn held_car(record: &CarRecord, car: usize) -> HeldCar {
    HeldCar { look: record.pose_from, bbox_px: record.bbox_px, score: record.score, car }
}
