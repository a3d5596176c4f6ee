//! The input and the output of a tracker.

use nalgebra::{Matrix3, Matrix6, Vector3};
use roadplane_base::{CarRef, FrameStamp, GroundPose, Shape, VehicleClass};
use roadplane_measure::{GroundContact, either};

use crate::{Evidence, Join};

/// Median distance (rms) of a car's keypoints from their projections, as a share of the box's longer side, in rendered
/// clips.
const USUAL_RMS_SHARE: f64 = 0.018;

/// An estimate of a car's shape: a Gaussian over its shape coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeEstimate {
    /// Mean of the shape coefficients, without unit.
    pub mean: Shape,
    /// Inverse covariance of the shape coefficients (6 × 6).
    pub information: Matrix6<f64>,
}

impl Default for ShapeEstimate {
    /// Returns the estimate for any car: the prior N(0, I) of the atlas.
    fn default() -> Self {
        Self { mean: Shape::zeros(), information: Matrix6::identity() }
    }
}

/// A box of the detector, at any score.
#[derive(Clone, Copy, Debug)]
pub struct Detection {
    /// The box (left, top, right, bottom), px.
    pub bbox_px: [f64; 4],
    /// Detector score, 0–1.
    pub score: f64,
    /// Class that the detector gives the box.
    pub class: VehicleClass,
    /// Mean colour of the middle of the box: red, green, blue. `None` where nearer vehicles hide it, and where it was not
    /// measured.
    pub colour_rgb: Option<[u8; 3]>,
    /// Edges (left, top, right, bottom) at which the picture cuts the vehicle off.
    pub cut: [bool; 4],
    /// Edges (left, top, right, bottom) at which another vehicle begins.
    pub hidden: [bool; 4],
    /// Index in its frame's list of cars. `None` for a weak box: its score is too low to count as a vehicle.
    pub car: Option<usize>,
    /// Whether the box is carried over: the nets did not run there, and it stays in its position.
    pub carried_over: bool,
}

impl Detection {
    /// Creates the detection of a box that shows its whole vehicle. It is weak.
    #[must_use]
    pub fn uncut(bbox_px: [f64; 4], score: f64, class: VehicleClass) -> Self {
        Self {
            bbox_px,
            score,
            class,
            colour_rgb: None,
            cut: [false; 4],
            hidden: [false; 4],
            car: None,
            carried_over: false,
        }
    }

    /// Whether the detector is certain of the box: its score is high enough to count as a vehicle.
    pub(crate) fn is_sure(&self) -> bool {
        self.car.is_some()
    }

    /// Returns the edges (left, top, right, bottom) beyond which the vehicle continues.
    pub(crate) fn goes_on(&self) -> [bool; 4] {
        either(self.cut, self.hidden)
    }
}

/// A car that was fitted in one frame.
#[derive(Clone, Debug)]
pub struct CarMeasurement {
    /// Pose of the car on the ground. Its heading may be wrong by π.
    pub pose: GroundPose,
    /// Covariance of (x, y, heading), m and rad. For keypoints, it assumes that their errors are independent.
    pub covariance: Matrix3<f64>,
    /// Its box. A car with keypoints has the class of a car.
    pub detection: Detection,
    /// Estimate of its shape before this frame.
    pub shape_before: ShapeEstimate,
    /// Estimate of its shape after this frame. It equals `shape_before` where the shape is fixed.
    pub shape: ShapeEstimate,
    /// Whether the pose comes from the box, without keypoints. Such a measurement extends a track. It starts a track
    /// only if it is not classed as a car.
    pub from_box: bool,
    /// Whether an earlier pass over the frames assigned it to a track.
    pub known: bool,
    /// Length, width and height (m) and their sds (m), of a vehicle that the shape model does not cover.
    pub dims_m: Option<[Vector3<f64>; 2]>,
    /// Distance (rms) of a car's keypoints from their projections, as a share of the box's longer side, at most that of
    /// a valid fit. It is there even where the pose comes from the box; `None` without keypoints.
    pub fit_rms_share: Option<f64>,
}

impl CarMeasurement {
    /// Creates the measurement of a vehicle that its box places. Its size and its shape are not measured.
    #[must_use]
    pub fn by_box(pose: GroundPose, covariance: Matrix3<f64>, seen: Detection) -> Self {
        Self {
            pose,
            covariance,
            detection: Detection { carried_over: false, ..seen },
            shape_before: ShapeEstimate::default(),
            shape: ShapeEstimate::default(),
            from_box: true,
            known: false,
            dims_m: None,
            fit_rms_share: None,
        }
    }

    /// Returns the pose as the vector (x, y, heading), m and rad.
    pub(crate) fn pose_vector(&self) -> Vector3<f64> {
        Vector3::new(self.pose.x_m, self.pose.y_m, self.pose.heading_rad)
    }

    /// Whether all numbers are finite, the box has an area and the covariance is positive definite.
    pub(crate) fn is_usable(&self) -> bool {
        let [x0, y0, x1, y1] = self.detection.bbox_px;
        let pose = self.pose_vector();
        let shapes = [&self.shape_before, &self.shape].into_iter();
        let finite = (pose.iter().chain(self.covariance.iter()).chain(self.detection.bbox_px.iter()))
            .chain(shapes.flat_map(|shape| shape.mean.iter().chain(shape.information.iter())));
        finite.copied().all(f64::is_finite)
            && self.detection.score.is_finite()
            && x1 > x0
            && y1 > y0
            && self.covariance.cholesky().is_some()
    }
}

/// A car that has not moved since an earlier inference frame. It counts as detected, but its pose is not measured
/// again.
#[derive(Clone, Copy, Debug)]
pub struct CarriedCar {
    /// Frame and index of the earlier measurement, where it had keypoints.
    pub source: Option<CarRef>,
    /// Its box.
    pub detection: Detection,
}

/// A car that is detected again, without a new measurement of its pose.
#[derive(Clone, Copy, Debug)]
pub struct SeenAgain {
    /// Frame and index of its last measurement.
    pub source: CarRef,
    /// Box of the car (left, top, right, bottom), px.
    pub bbox_px: [f64; 4],
    /// Score of the detector, 0–1.
    pub score: f64,
}

/// All cars that were fitted in one frame. A frame without cars counts as a frame, too.
#[derive(Clone, Debug)]
pub struct FrameMeasurements {
    /// Index and time of the frame.
    pub stamp: FrameStamp,
    /// Time from the time stamp to the moment at which the picture was taken, s ([`Clock`](crate::Clock)).
    pub delay_s: f64,
    /// Whether this is an inference frame. In any other frame only the cars that are carried over are given, and no
    /// track counts a miss.
    pub is_inferred: bool,
    /// Cars that were fitted in the frame.
    pub cars: Vec<CarMeasurement>,
    /// Cars that are carried over.
    pub carried_over: Vec<CarriedCar>,
    /// Cars that were detected again so soon after an inference frame that nothing measured them. Their tracks accept
    /// no other box.
    pub seen_again: Vec<SeenAgain>,
    /// All boxes of the frame, those with low scores included. If no tracklet has a box, linking decides which vehicle
    /// it shows. Empty while no vehicle has been estimated yet.
    pub boxes: Vec<Detection>,
}

impl FrameMeasurements {
    /// Creates an inference frame in which no car is carried over.
    #[must_use]
    pub fn seen(stamp: FrameStamp, cars: Vec<CarMeasurement>) -> Self {
        Self {
            stamp,
            delay_s: 0.0,
            is_inferred: true,
            cars,
            carried_over: Vec::new(),
            seen_again: Vec::new(),
            boxes: Vec::new(),
        }
    }
}

/// An observation: a detection of a track, with its pose.
#[derive(Clone, Debug)]
pub(crate) struct Observation {
    /// Index of the frame, among all frames that the tracker was given.
    pub frame: usize,
    /// Time since the first frame, s.
    pub time_s: f64,
    /// Pose (x, y, heading) on the ground, m and rad.
    pub pose: Vector3<f64>,
    /// Covariance of (x, y, heading), m and rad.
    pub covariance: Matrix3<f64>,
    /// Its box. If it is carried over, pose and covariance are those of an earlier detection.
    pub detection: Detection,
    /// Whether the pose comes from the box: it has an axis, but no front.
    pub from_box: bool,
    /// Distance (rms) of a car's keypoints from their projections, as a share of the box's longer side; `None` without
    /// keypoints.
    pub fit_rms_share: Option<f64>,
}

impl Observation {
    /// Returns the distance (rms) of a car's keypoints from their projections, relative to the usual one; `None` without
    /// keypoints.
    pub(crate) fn misfit(&self) -> Option<f64> {
        Some(self.fit_rms_share?.max(1e-3) / USUAL_RMS_SHARE)
    }

    /// Creates an observation from a box and the pose at which the box places the vehicle. `time_s` counts from the first
    /// frame.
    pub(crate) fn by_box(seen: &Detection, placed: &GroundContact, frame: usize, time_s: f64) -> Self {
        let GroundContact { pose, covariance, .. } = *placed;
        let pose = Vector3::new(pose.x_m, pose.y_m, pose.heading_rad);
        // The box gives its own pose, so nothing of the pose is carried over.
        let detection = Detection { carried_over: false, ..*seen };
        Self { frame, time_s, pose, covariance, detection, from_box: true, fit_rms_share: None }
    }
}

/// One vehicle over time.
#[derive(Clone, Debug)]
pub struct Track {
    /// Number of the track, from 1. Tracks are ordered by first frame, then by x.
    pub id: u64,
    /// Class of the vehicle, by the scores of all its detections.
    pub class: VehicleClass,
    /// Length, width and height, m, of a vehicle that is no car.
    pub dims_m: Option<Vector3<f64>>,
    /// Covariance of length, width and height, m², where the path and the boxes determine it.
    pub dims_covariance: Option<Matrix3<f64>>,
    /// One state for every frame from the first detection to the last.
    pub states: Vec<TrackState>,
    /// Shape of the vehicle: all views fused, with the prior counted once.
    pub shape: ShapeEstimate,
    /// Evidence on whether the track is a vehicle.
    pub evidence: Evidence,
    /// Joins over gaps, in the order of time.
    pub joins: Vec<Join>,
}

impl Track {
    /// Returns the states in which the vehicle was measured, each with its frame and index there.
    pub fn measured(&self) -> impl Iterator<Item = (CarRef, &TrackState)> {
        self.states
            .iter()
            .filter_map(|state| Some((CarRef { frame: state.stamp.index, car: state.car? }, state)))
    }
}

/// The state of a track at one frame.
#[derive(Clone, Debug)]
pub struct TrackState {
    /// Index and time of the frame.
    pub stamp: FrameStamp,
    /// Smoothed pose on the ground.
    pub pose: GroundPose,
    /// Sd of x, y (m) and heading (rad).
    pub pose_sd: Vector3<f64>,
    /// Speed along the heading, m/s; negative when the vehicle reverses.
    pub speed_mps: f64,
    /// Sd of the speed, m/s.
    pub speed_sd_mps: f64,
    /// Box of the vehicle (left, top, right, bottom), px, where it was detected. Otherwise the state is filled in.
    pub bbox_px: Option<[f64; 4]>,
    /// Detector score, 0–1; 0 where the vehicle was not detected.
    pub score: f64,
    /// Index of the car in its frame's list, where it was measured. `None` where a weak box is the detection.
    pub car: Option<usize>,
}
