//! One pass over the frames of a time chunk: it fits every car and tracks all vehicles.

use std::collections::BTreeMap;

use roadplane_base::{
    CarRef, FrameRecord, FrameStamp, PoseRecord, ShapeAtlas, VehicleClass, bbox_cut, bbox_part_seen,
};
use roadplane_geo::Place;
use roadplane_measure::{FrameCamera, Knowledge, fit_frame, ground_contact, hidden_edges, projected_box};
use roadplane_solve::{CarFit, SceneOptions, ShapePrior};
use roadplane_track::{
    CarMeasurement, CarriedCar, Clock, Detection, FrameMeasurements, SeenAgain, ShapeEstimate, Track,
    TrackOptions, TrackStep, Tracker, Tracks,
};

use crate::cameras::camera_track::CameraTrack;
use crate::tracks::chunks::TimeChunk;
use crate::tracks::known::TrackedCar;
use crate::tracks::poses::{CarriedPoses, pose_record};
use crate::tracks::scene::SiteScene;
use crate::tracks::views::Views;
use crate::{Config, PipelineError};

/// Counts of cars; each car of each frame counts once.
#[derive(Debug, Default)]
pub struct Tally {
    /// Number of boxes by class.
    pub boxes: BTreeMap<String, u64>,
    /// Number of rejected cars by reason.
    pub rejected: BTreeMap<String, u64>,
    /// Number of tracks that are left out, because they are probably no vehicles.
    pub left_out_tracks: u64,
}

/// The input of a pass over the frames.
pub(crate) struct Pass<'a> {
    /// Camera at every time.
    pub cameras: &'a CameraTrack,
    /// Times at which the pictures were taken.
    pub clock: &'a Clock,
    /// Position of the camera on the map, if given.
    pub place: Option<&'a Place>,
    pub atlas: &'a ShapeAtlas,
    /// Prior of a car's shape before it is detected.
    pub any_car: ShapePrior,
    pub options: SceneOptions,
    pub config: &'a Config,
}

impl Pass<'_> {
    /// Fits and tracks all cars of all frames that the chunk needs. Returns the tracks and the views.
    ///
    /// `known` contains the results of an earlier pass. Its cars are fitted with the shape of their
    /// track, from the pose of their track. Boxes that belong to no vehicle are used only with `known`.
    ///
    /// Poses go to `sink` and counts to `tally`, but only from frames inside the chunk.
    pub(crate) fn tracks(
        &self,
        frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
        chunk: TimeChunk,
        known: Option<&BTreeMap<CarRef, TrackedCar>>,
        tally: &mut Tally,
        mut sink: impl FnMut(&PoseRecord) -> Result<(), PipelineError>,
    ) -> Result<(Vec<Track>, Views), PipelineError> {
        // Coordinates of different camera positions are unrelated, so each position has its own tracker. Where the camera
        // returns to a position, its tracks go on.
        let mut at_position: BTreeMap<usize, Tracker> = BTreeMap::new();
        // Only the second pass decides which tracks are vehicles: it knows the shape of each.
        let min_exists_p = if known.is_some() { self.config.track.min_exists_p } else { 0.0 };
        let new = || Tracker::new(TrackOptions { min_exists_p, ..self.config.track.clone() });
        let mut views = Views::default();
        let mut poses_so_far = CarriedPoses::default();
        let limits = self.config.solve.fit_limits();
        for frame in frames {
            let frame = frame?;
            let own = chunk.holds(frame.time_s);
            let Some(estimate) = self.cameras.at(frame.time_s) else { continue };
            let position = self.cameras.position_at(frame.time_s);
            let tracker = at_position.entry(position).or_insert_with(new);
            views.add(&frame);
            let picture_px = frame.picture_px();
            let view = FrameCamera::from(estimate);
            let tracked_car =
                |car: usize| known.and_then(|known| known.get(&CarRef { frame: frame.frame, car }));
            let prior = |car: usize| match tracked_car(car) {
                Some(TrackedCar { vehicle, pose, .. }) => {
                    (ShapePrior::fixed_at(vehicle.shape.mean, vehicle.shape.information), Some(*pose))
                }
                None => (self.any_car, None),
            };
            let least_score = self.config.solve.min_keypoint_score;
            let fitted = fit_frame(&frame, &view, self.atlas, &self.options, least_score, prior);
            let (mut cars, mut carried_over, mut seen_again, mut boxes) =
                (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            for (index, fit) in fitted.into_iter().enumerate() {
                let record = &frame.cars[index];
                if let Some(source) = record.seen_after {
                    seen_again.push(SeenAgain { source, bbox_px: record.bbox_px, score: record.score });
                    continue;
                }
                let seen =
                    self.detection(&frame, record.bbox_px, record.score, record.colour_rgb, Some(index));
                boxes.extend(known.map(|_| seen));
                let carried_car = CarriedCar { source: record.pose_from, detection: seen };
                // A carried-over box with keypoints is a new measurement.
                if record.is_carried_over() && record.keypoints.is_none() {
                    carried_over.push(carried_car);
                    if let Some(pose) = poses_so_far.line(&frame, index).filter(|_| own) {
                        sink(&pose)?;
                    }
                    continue;
                }
                let class = format!("{:?}", record.class).to_lowercase();
                *tally.boxes.entry(class).or_insert(0) += u64::from(own);
                let reason = match &fit {
                    None => Some("no_pose"),
                    Some(fit) => {
                        let car = &fit.car;
                        let projected =
                            projected_box(self.atlas, &view.camera, &car.camera_from_car, &car.shape)
                                .map(|whole| bbox_part_seen(&whole, &record.bbox_px, seen.hidden));
                        let rms = car.reprojection_rms_px;
                        let is_valid = limits.is_valid(projected, &record.bbox_px, rms, &picture_px);
                        (!(car.used && is_valid)).then_some("keypoints_disagree")
                    }
                };
                let tracked = tracked_car(index);
                // The net finds a car's keypoints in a truck, too.
                let is_car = tracked.is_none_or(|car| car.vehicle.body.class == VehicleClass::Car);
                let usable = fit.as_ref().filter(|_| reason.is_none() && is_car);
                let measured = usable
                    .map(|fit| by_keypoints(fit, seen, self.any_car, tracked))
                    .or_else(|| by_box(seen, &view, tracked));
                match measured {
                    Some(measured) => {
                        let rms_share = |fit: &CarFit| fit.car.reprojection_rms_px / record.longer_side_px();
                        let share = fit.as_ref().map(rms_share).filter(|share| share.is_finite());
                        // Fits that are not valid are all alike.
                        let fit_rms_share = share.map(|share| share.min(limits.max_rms_share));
                        cars.push(CarMeasurement { known: tracked.is_some(), fit_rms_share, ..measured });
                    }
                    None => {
                        carried_over.extend(record.is_carried_over().then_some(carried_car));
                        *tally.rejected.entry(reason.unwrap_or("no_pose").to_owned()).or_insert(0) +=
                            u64::from(own)
                    }
                }
                let Some(fit) = fit else { continue };
                if let Some(mut pose) = pose_record(&frame, index, &fit, &view, self.atlas) {
                    pose.used = reason.is_none() && is_car;
                    poses_so_far.store(&pose);
                    if own {
                        sink(&pose)?;
                    }
                }
            }
            let pts_nanos = (frame.time_s * 1e9).round() as i64;
            let stamp = FrameStamp { index: frame.frame, pts_nanos };
            let delay_s = self.clock.delay_s(frame.time_s);
            let is_inferred = frame.watch.as_ref().is_none_or(|watch| watch.looked);
            let weak = frame.weak.iter().filter(|_| known.is_some());
            boxes.extend(
                weak.map(|weak| self.detection(&frame, weak.bbox_px, weak.score, weak.colour_rgb, None)),
            );
            let rejected = tracker.rejected;
            tracker.push(&FrameMeasurements {
                stamp,
                delay_s,
                is_inferred,
                cars,
                carried_over,
                seen_again,
                boxes,
            });
            if own && tracker.rejected > rejected {
                *tally.rejected.entry("pose_not_finite".to_owned()).or_insert(0) +=
                    (tracker.rejected - rejected) as u64;
            }
        }
        let mut tracks = Vec::new();
        let scene = SiteScene { cameras: self.cameras, atlas: self.atlas, mean_car: &self.any_car.mean };
        for tracker in at_position.into_values() {
            let Tracks { tracks: found, left_out } = tracker.finish(&scene);
            tracks.extend(found);
            let own = left_out.iter().filter(|stamp| chunk.holds(stamp.time_s()));
            tally.left_out_tracks += own.count() as u64;
        }
        Ok((tracks, views))
    }

    /// Builds the detection of a box that may be a vehicle; `car` is its index in the frame's cars, if it is one of them.
    fn detection(
        &self,
        frame: &FrameRecord,
        bbox_px: [f64; 4],
        score: f64,
        colour_rgb: Option<[u8; 3]>,
        car: Option<usize>,
    ) -> Detection {
        let class = car.map_or(VehicleClass::Car, |car| frame.cars[car].class);
        let others = frame.cars.iter().enumerate().filter(|(other, _)| Some(*other) != car);
        let hidden = if self.config.track.takes(TrackStep::HiddenEdges) {
            hidden_edges(&bbox_px, others.map(|(_, other)| &other.bbox_px))
        } else {
            [false; 4]
        };
        let colour_rgb = colour_rgb.filter(|_| self.config.track.takes(TrackStep::Colours));
        let carried_over = car.is_some_and(|car| frame.cars[car].held_since.is_some());
        Detection {
            bbox_px,
            score,
            class,
            colour_rgb,
            cut: bbox_cut(&bbox_px, &frame.picture_px()),
            hidden,
            car,
            carried_over,
        }
    }
}

/// Builds the measurement of a car from its keypoints. If the car has a track, its shape was fixed.
fn by_keypoints(
    fit: &CarFit,
    seen: Detection,
    any_car: ShapePrior,
    tracked: Option<&TrackedCar>,
) -> CarMeasurement {
    let (shape_before, shape) = match tracked {
        Some(car) => (car.vehicle.shape, car.vehicle.shape),
        None => {
            let before = ShapeEstimate { mean: any_car.mean, information: any_car.information };
            let after = |information| ShapeEstimate { mean: fit.car.shape, information };
            (before, fit.car.shape_covariance.try_inverse().map_or(before, after))
        }
    };
    let detection = Detection { class: VehicleClass::Car, ..seen };
    let measured = CarMeasurement::by_box(fit.car.ground, fit.car.ground_covariance, detection);
    CarMeasurement { shape_before, shape, from_box: false, ..measured }
}

/// Builds the measurement of a vehicle whose box is more informative than its keypoints.
fn by_box(seen: Detection, view: &FrameCamera, tracked: Option<&TrackedCar>) -> Option<CarMeasurement> {
    let knowledge = match tracked {
        Some(car) => Knowledge::Track {
            body: car.vehicle.body,
            heading_rad: car.pose.heading_rad,
            heading_sd_rad: car.heading_sd_rad,
        },
        None => Knowledge::Label(seen.class),
    };
    let found = ground_contact(&seen.bbox_px, seen.cut, seen.hidden, view, &knowledge)?;
    let measured = CarMeasurement::by_box(found.pose, found.covariance, seen);
    Some(CarMeasurement { dims_m: Some(found.dims_m), ..measured })
}
