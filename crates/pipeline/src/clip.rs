//! The right half of a run: records of all frames → camera over time, poses, smoothed tracks.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use nalgebra::{Matrix6, Vector2, Vector3};
use roadplane_base::{
    CameraEstimate, CameraStatus, CarRecord, CarRef, FrameRecord, FrameStamp, GroundPose, ImageSize,
    PoseRecord, Shape, ShapeAtlas, TrackRow, VehicleClass, WatchRecord, bbox_moved,
};
use roadplane_calibrate::AtRest;
use roadplane_geo::{Place, Site};
use roadplane_solve::{CarFit, SceneOptions, ShapePrior};
use roadplane_track::{CarMeasurement, FrameMeasurements, HeldCar, SeenAgain, Track, TrackState, Tracker};
use roadplane_write::{FrameReader, PoseLines, read_jsonl, read_scene_curves};

use crate::believe::{is_believable, is_vehicle, overlap_inside, projected_box};
use crate::cameras::{CameraTrack, estimate_cameras};
use crate::cars::{FrameCamera, HeldPoses, any_car, fit_frame, pose_record};
use crate::ground_contact::{Body, Knowledge, body_box, cut_edges, ground_contact};
use crate::hidden::{hidden_edges, part_seen};
use crate::known::contradiction;
use crate::memory::Recall;
use crate::shared_error::shared_covariance;
use crate::{Cancel, Config, Known, PipelineError};

/// Least overlap of the box of a row that is called observed with that of the vehicle where the row has it.
const MIN_ROW_OVERLAP: f64 = 0.3;
/// How well a track's size is known to later looks at it, m.
const KNOWN_DIMS_SD_M: f64 = 0.3;
/// Least sd of a track's heading for the same, rad.
const KNOWN_HEADING_SD_RAD: f64 = 0.05;

/// What became of a clip.
#[derive(Debug)]
pub struct ClipSolution {
    /// The camera, a stretch of time each.
    pub cameras: CameraTrack,
    /// Where it stands on the map, where that was told.
    pub place: Option<Place>,
    /// All tracks, by number.
    pub tracks: Vec<Track>,
    /// Rows of the track files, by frame, then by track.
    pub rows: Vec<TrackRow>,
    /// Root mean square reprojection errors of the tracked poses, px.
    pub reprojection_rms_px: Vec<f64>,
    /// Cars (car and frame) with a pose that is used.
    pub poses_used: u64,
    /// Cars found and dropped.
    pub tally: Tally,
    /// What a reader should know.
    pub warnings: Vec<String>,
}

impl ClipSolution {
    /// Shape of each track.
    #[must_use]
    pub fn shapes(&self) -> BTreeMap<u64, Shape> {
        self.tracks.iter().map(|track| (track.id, track.shape)).collect()
    }

    /// The camera in words, for a log line.
    #[must_use]
    pub fn camera_in_words(&self) -> String {
        let Some(first) = self.cameras.estimates().first() else { return "no camera".to_owned() };
        let focal_px = first.params.focal_px();
        let sd = |i: usize| first.covariance[(i, i)].max(0.0).sqrt();
        let height_m = first.params.log_height.exp();
        format!(
            "focal {focal_px:.0} ± {:.0} px, height {height_m:.1} ± {:.1} m, tilt {:.1} ± {:.1}° ({})",
            focal_px * sd(0),
            height_m * sd(3),
            first.params.tilt.to_degrees(),
            sd(1).to_degrees(),
            match first.status {
                CameraStatus::Estimated => "estimated",
                CameraStatus::FocalGiven => "focal given",
                CameraStatus::FocalFromPrior => "focal from prior",
                CameraStatus::Unobservable => "unobservable",
            },
        )
    }
}

/// Solves a clip from its frames file and writes `poses.jsonl`. Every pass streams over the file.
///
/// # Errors
/// [`PipelineError`]; the poses file then does not appear.
pub fn solve_clip(
    frames: &Path,
    poses: &Path,
    atlas: &ShapeAtlas,
    known: &Known,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipSolution, PipelineError> {
    solve_known_clip(frames, poses, atlas, &Given { known, recall: None, site: None }, config, cancel)
}

/// What is known of a clip's camera before it is seen.
pub(crate) struct Given<'a> {
    /// What the user knows.
    pub known: &'a Known,
    /// What is remembered.
    pub recall: Option<&'a Recall>,
    /// Its place on the map.
    pub site: Option<&'a Site>,
}

/// The same, with what is known of the camera before.
pub(crate) fn solve_known_clip(
    frames: &Path,
    poses: &Path,
    atlas: &ShapeAtlas,
    given: &Given<'_>,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipSolution, PipelineError> {
    let read = || -> Result<_, PipelineError> {
        Ok(AtRest::new(FrameReader::open(frames)?.map(|record| {
            cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }))?;
            Ok(record?)
        })))
    };
    let Given { known, recall, site } = *given;
    let mut cameras = estimate_cameras(read()?, &read_scene_curves(frames)?, atlas, known, recall, config)?;
    let mut warnings = warnings_of(&cameras);
    let place = site.and_then(|site| {
        let place = cameras.put_on_map(site);
        place.map_err(|what| warnings.push(format!("not put on the map: {what}"))).ok()
    });
    if let Some(Place { fit, .. }) = &place {
        tracing::info!("{fit}");
        warnings.extend(fit.warnings.iter().cloned());
    }
    let contradictions = cameras.known().iter().filter_map(contradiction);
    let told: Vec<String> =
        contradictions.chain(known.silent_later().filter(|_| cameras.moves() > 0)).collect();
    let on_map = if site.is_some() { &warnings[..] } else { &[] };
    on_map.iter().chain(&told).for_each(|warning| tracing::warn!("{warning}"));
    warnings.extend(told);
    let any_car = any_car(atlas, cameras.size_of_cars());
    let pass = Pass {
        cameras: &cameras,
        place: place.as_ref(),
        atlas,
        any_car,
        options: config.solve.scene_options(None),
        config,
    };
    // First with every car's shape free in every frame; then with the one shape that its track came to.
    let (first, _) = pass.tracks(read()?, &BTreeMap::new(), |_| Ok(()))?;
    let spool = poses.with_extension("spool");
    let mut spooled = PoseLines::create(&spool)?;
    let vehicles = known_cars(&first, atlas);
    // A long clip's tracks are large: none is kept for longer than it is needed.
    drop(first);
    let (mut tracks, tally) = pass.tracks(read()?, &vehicles, |pose| Ok(spooled.write(pose)?))?;
    spooled.finish()?;
    for track in &mut tracks {
        // The shape was held in this pass, so what this pass's tracks say of it is no evidence.
        let held = sightings(track).find_map(|(key, _)| vehicles.get(&key));
        let held = held.map(|known| known.vehicle.shape.mean);
        track.shape = atlas.clamped(&held.unwrap_or(track.shape));
    }
    drop(vehicles);
    tracks.retain(|track| pass.is_where_it_is_seen(track));
    for (id, track) in (1..).zip(&mut tracks) {
        track.id = id;
    }

    let tracked: BTreeMap<CarRef, u64> =
        tracks.iter().flat_map(|track| sightings(track).map(|(key, _)| (key, track.id))).collect();
    let mut lines = PoseLines::create(poses)?;
    let mut reprojection_rms_px = Vec::new();
    let mut poses_used = 0;
    for pose in read_jsonl::<PoseRecord>(&spool)? {
        let mut pose = pose?;
        pose.track = tracked.get(&CarRef { frame: pose.frame, car: pose.car }).copied();
        poses_used += u64::from(pose.used);
        if pose.track.is_some() && pose.pose_from.is_none() {
            reprojection_rms_px.push(pose.reprojection_rms_px);
        }
        lines.write(&pose)?;
    }
    lines.finish()?;
    drop(tracked);
    std::fs::remove_file(&spool)
        .map_err(|source| PipelineError::Unreadable { source, path: spool.clone() })?;
    let mut rows: Vec<TrackRow> = tracks.iter().flat_map(|track| pass.rows(track, &tally.shake_px)).collect();
    rows.sort_by_key(|row| (row.frame, row.track));
    Ok(ClipSolution { cameras, place, tracks, rows, reprojection_rms_px, poses_used, tally, warnings })
}

/// Counts of cars (car and frame).
#[derive(Debug, Default)]
pub struct Tally {
    /// Boxes by class.
    pub boxes: BTreeMap<String, u64>,
    /// Cars dropped, by reason.
    pub rejected: BTreeMap<String, u64>,
    /// Offset of the picture in frames in which it was shaken, px.
    pub shake_px: BTreeMap<u64, Vector2<f64>>,
}

/// What a pass over the frames needs.
struct Pass<'a> {
    cameras: &'a CameraTrack,
    place: Option<&'a Place>,
    atlas: &'a ShapeAtlas,
    /// What is known of a car's shape before it is looked at.
    any_car: ShapePrior,
    options: SceneOptions,
    config: &'a Config,
}

impl Pass<'_> {
    /// Fits all cars of all frames and tracks them; cars in `known` have that shape and about that pose. Gives the tracks
    /// and counts of what was found and dropped.
    fn tracks(
        &self,
        frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
        known: &BTreeMap<CarRef, KnownCar>,
        mut sink: impl FnMut(&PoseRecord) -> Result<(), PipelineError>,
    ) -> Result<(Vec<Track>, Tally), PipelineError> {
        let mut tracker = Tracker::new(self.config.track.clone());
        let mut tracks = Vec::new();
        let mut tally = Tally::default();
        let mut position = None;
        let mut looked_s = Vec::new();
        let mut looks = HeldPoses::default();
        for frame in frames {
            let frame = frame?;
            let Some(estimate) = self.cameras.at(frame.time_s) else { continue };
            // Coordinates of one camera position mean nothing in another: tracks end where the camera was moved.
            let here = self.cameras.position_at(frame.time_s);
            if position.replace(here).is_some_and(|before| before != here) {
                let ended = std::mem::replace(&mut tracker, Tracker::new(self.config.track.clone()));
                append(&mut tracks, ended.finish());
            }
            if let Some(shake) =
                frame.watch.as_ref().map(WatchRecord::offset).filter(|shake| shake.norm() > 0.0)
            {
                tally.shake_px.insert(frame.frame, shake);
            }
            let view = FrameCamera::from(estimate);
            let prior = |i: usize| match known.get(&CarRef { frame: frame.frame, car: i }) {
                Some(known) => (known.vehicle.shape, Some(known.pose)),
                None => (self.any_car, None),
            };
            let fitted = fit_frame(&frame, &view, self.atlas, &self.options, self.config, prior);
            let (mut cars, mut held, mut seen_again) = (Vec::new(), Vec::new(), Vec::new());
            for (index, fit) in fitted.into_iter().enumerate() {
                let record = &frame.cars[index];
                if let Some(look) = record.seen_after {
                    seen_again.push(SeenAgain { look, bbox_px: record.bbox_px });
                    continue;
                }
                if record.held_since.is_some() || record.pose_from.is_some() {
                    held.push(held_car(record, index));
                    if let Some(pose) = looks.line(&frame, index) {
                        sink(&pose)?;
                    }
                    if record.keypoints.is_none() {
                        continue;
                    }
                }
                let others = frame.cars.iter().enumerate().filter(|(other, _)| *other != index);
                let hidden = hidden_edges(&record.bbox_px, others.map(|(_, other)| &other.bbox_px));
                let class = format!("{:?}", record.class).to_lowercase();
                *tally.boxes.entry(class).or_insert(0) += 1;
                let reason = match &fit {
                    None => Some("no_pose"),
                    Some(fit) => {
                        let car = &fit.car;
                        let projected =
                            projected_box(self.atlas, &view.camera, &car.camera_from_car, &car.shape)
                                .map(|whole| part_seen(&whole, &record.bbox_px, hidden));
                        let (rms, size) = (car.reprojection_rms_px, frame.image_size_px);
                        let believable = is_believable(projected, &record.bbox_px, rms, size, self.config);
                        (!(car.used && believable)).then_some("keypoints_disagree")
                    }
                };
                let known = known.get(&CarRef { frame: frame.frame, car: index });
                let at_edge = cut_edges(&record.bbox_px, frame.image_size_px).contains(&true);
                let is_hidden = hidden.contains(&true);
                // The net finds a car's keypoints in a truck, too.
                let is_car = known.is_none_or(|known| known.vehicle.class == VehicleClass::Car);
                match (&fit, reason) {
                    (Some(fit), None) if is_car => cars.push(CarMeasurement {
                        at_edge,
                        hidden: is_hidden,
                        ..measurement(fit, record, index)
                    }),
                    (_, reason) => match self.by_box(record, index, &frame, hidden, &view, known) {
                        Some(measured) => {
                            cars.push(CarMeasurement { at_edge, hidden: is_hidden, ..measured })
                        }
                        None => {
                            *tally.rejected.entry(reason.unwrap_or("no_pose").to_owned()).or_insert(0) += 1
                        }
                    },
                }
                let Some(fit) = fit else { continue };
                if let Some(mut pose) = pose_record(&frame, index, &fit, self.atlas) {
                    pose.used = reason.is_none() && is_car;
                    looks.remember(&pose);
                    sink(&pose)?;
                }
            }
            let pts_nanos = (frame.time_s * 1e9).round() as i64;
            let stamp = FrameStamp { index: frame.frame, pts_nanos };
            let looked = frame.watch.as_ref().is_none_or(|watch| watch.looked);
            // Where something was held it counts as looked at, too.
            if looked || !held.is_empty() {
                looked_s.push(frame.time_s);
            }
            tracker.push(&FrameMeasurements { stamp, looked, cars, held, seen_again });
        }
        append(&mut tracks, tracker.finish());
        tracks.retain(|track| is_vehicle(track, self.dims_m(track).z, &looked_s));
        Ok((tracks, tally))
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
            shape: Shape::zeros(),
            shape_information: Matrix6::identity(),
            car,
            from_box: true,
            at_edge: false,
            hidden: false,
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
    fn is_where_it_is_seen(&self, track: &Track) -> bool {
        let (mut own, mut sightings) = (0, 0);
        for state in track.states.iter().filter(|state| state.observed) {
            let Some(estimate) = self.cameras.at(state.stamp.time_s()) else { continue };
            let projected = self.projected_box(track, state);
            sightings += 1;
            own += usize::from(self.own_box(state, projected.as_ref(), estimate.image_size_px).is_some());
        }
        2 * own >= sightings
    }

    /// A track's rows; boxes are where the shaken picture has them.
    fn rows(&self, track: &Track, shake_px: &BTreeMap<u64, Vector2<f64>>) -> Vec<TrackRow> {
        let dims = self.dims_m(track);
        let row = |state: &TrackState| {
            let projected = self.projected_box(track, state);
            let estimate = self.cameras.at(state.stamp.time_s())?;
            let seen_px = self.own_box(state, projected.as_ref(), estimate.image_size_px);
            let at_rest = seen_px.or(projected)?;
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
            return body_box(&view, &state.pose, &dims_m);
        }
        let camera_from_car = view.plane.camera_from_world() * state.pose.world_from_car();
        projected_box(self.atlas, &view.camera, &camera_from_car, &track.shape)
    }

    /// Length, width, height of a track's vehicle.
    fn dims_m(&self, track: &Track) -> Vector3<f64> {
        track.dims_m.unwrap_or_else(|| self.atlas.dims_m(&self.atlas.clamped(&track.shape)))
    }
}

/// Adds tracks of a later camera position; their numbers go on.
fn append(tracks: &mut Vec<Track>, later: Vec<Track>) {
    let before = tracks.iter().map(|track| track.id).max().unwrap_or(0);
    tracks.extend(later.into_iter().map(|track| Track { id: track.id + before, ..track }));
}

fn measurement(fit: &CarFit, record: &CarRecord, car: usize) -> CarMeasurement {
    let shape_information: Matrix6<f64> =
        fit.car.shape_covariance.try_inverse().unwrap_or_else(Matrix6::identity);
    CarMeasurement {
        pose: fit.car.ground,
        covariance: fit.car.ground_covariance,
        bbox_px: record.bbox_px,
        score: record.score,
        class: VehicleClass::Car,
        shape: fit.car.shape,
        shape_information,
        car,
        from_box: false,
        at_edge: false,
        hidden: false,
        dims_m: None,
    }
}

/// A vehicle that is where it was.
fn held_car(record: &CarRecord, car: usize) -> HeldCar {
    HeldCar { look: record.pose_from, bbox_px: record.bbox_px, score: record.score, car }
}

/// What a first pass over the frames tells the second of the vehicle in a box.
struct KnownCar {
    vehicle: Arc<KnownVehicle>,
    pose: GroundPose,
    heading_sd_rad: f64,
}

/// The same for all its boxes.
struct KnownVehicle {
    shape: ShapePrior,
    body: Body,
    class: VehicleClass,
}

/// The states in which a track was seen, with the car that it was seen as.
fn sightings(track: &Track) -> impl Iterator<Item = (CarRef, &TrackState)> {
    track
        .states
        .iter()
        .filter_map(|state| Some((CarRef { frame: state.stamp.index, car: state.car? }, state)))
}

/// Per tracked car and frame its track's shape, within the atlas' bounds, and its smoothed pose.
fn known_cars(tracks: &[Track], atlas: &ShapeAtlas) -> BTreeMap<CarRef, KnownCar> {
    let mut known = BTreeMap::new();
    for track in tracks {
        let shape = ShapePrior::known(atlas.clamped(&track.shape));
        let dims_m = track.dims_m.unwrap_or_else(|| atlas.dims_m(&shape.mean));
        let body = Body { dims_m, sd_m: Vector3::repeat(KNOWN_DIMS_SD_M) };
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

fn warnings_of(cameras: &CameraTrack) -> Vec<String> {
    let mut warnings = Vec::new();
    let about = |estimate: &CameraEstimate| match estimate.status {
        CameraStatus::Unobservable => Some("the camera could not be estimated: its numbers are the prior"),
        CameraStatus::FocalFromPrior => {
            Some("the cars say little about the focal length: it rests on the prior")
        }
        CameraStatus::Estimated | CameraStatus::FocalGiven => None,
    };
    for warning in cameras.estimates().iter().filter_map(about) {
        if !warnings.iter().any(|known| known == warning) {
            warnings.push(warning.to_owned());
        }
    }
    if cameras.estimates().is_empty() {
        warnings.push("no frame could be read".to_owned());
    }
    warnings
}
