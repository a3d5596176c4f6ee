//! What goes in and what comes out.

use nalgebra::{Matrix3, Matrix6, Vector3};
use roadplane_base::{CarRef, FrameStamp, GroundPose, Shape, VehicleClass};

/// Mean score of its sightings below which a track is doubtful.
pub const SURE_SCORE: f64 = 0.46;

/// What is known of a car's shape: a Gaussian on its coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeBelief {
    /// Mean coefficients.
    pub mean: Shape,
    /// Inverse covariance.
    pub information: Matrix6<f64>,
}

impl Default for ShapeBelief {
    /// Of any car: the atlas' N(0, I).
    fn default() -> Self {
        Self { mean: Shape::zeros(), information: Matrix6::identity() }
    }
}

impl ShapeBelief {
    fn numbers(&self) -> impl Iterator<Item = &f64> {
        self.mean.iter().chain(self.information.iter())
    }
}

/// A car fitted in one frame.
#[derive(Clone, Debug)]
pub struct CarMeasurement {
    /// Where it stands; the heading may be turned by π.
    pub pose: GroundPose,
    /// Covariance of (x, y, heading), m and rad.
    pub covariance: Matrix3<f64>,
    /// Box, px.
    pub bbox_px: [f64; 4],
    /// Detector's score, 0–1.
    pub score: f64,
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// What was known of its shape before the look …
    pub shape_before: ShapeBelief,
    /// … and after it; the same where the shape is held.
    pub shape: ShapeBelief,
    /// Position of the car in its frame's list.
    pub car: usize,
    /// The pose is what the box says, not keypoints: it goes on with a track, and only what is no car begins one.
    pub from_box: bool,
    /// Left, top, right, bottom: the picture ends there.
    pub cut: [bool; 4],
    /// Left, top, right, bottom: another vehicle begins there.
    pub hidden: [bool; 4],
    /// An earlier pass over the frames had it on a track.
    pub known: bool,
    /// Length, width, height and their sds, m, of a vehicle that the shape does not cover.
    pub dims_m: Option<[Vector3<f64>; 2]>,
}

impl CarMeasurement {
    pub(crate) fn pose_vector(&self) -> Vector3<f64> {
        Vector3::new(self.pose.x_m, self.pose.y_m, self.pose.heading_rad)
    }

    /// Called a car, without the keypoints of one: no track begins with it.
    pub(crate) fn lacks_keypoints(&self) -> bool {
        self.from_box && self.class == VehicleClass::Car
    }

    /// Finite, with a covariance and a box that can be.
    pub(crate) fn is_usable(&self) -> bool {
        let [x0, y0, x1, y1] = self.bbox_px;
        let numbers = self.pose_vector();
        let finite = numbers
            .iter()
            .chain(self.covariance.iter())
            .chain(self.bbox_px.iter())
            .chain(self.shape_before.numbers())
            .chain(self.shape.numbers());
        finite.copied().all(f64::is_finite)
            && self.score.is_finite()
            && x1 > x0
            && y1 > y0
            && self.covariance.cholesky().is_some()
    }
}

/// A car that has not moved since an earlier look at it: it is seen, and measured no better.
#[derive(Clone, Copy, Debug)]
pub struct HeldCar {
    /// The look, where it had keypoints.
    pub look: Option<CarRef>,
    /// Box, px.
    pub bbox_px: [f64; 4],
    /// Detector's score, 0–1.
    pub score: f64,
    /// Position of the car in its frame's list.
    pub car: usize,
}

/// A car that is seen again, and measured no better.
#[derive(Clone, Copy, Debug)]
pub struct SeenAgain {
    /// The last look that measured it.
    pub look: CarRef,
    /// Box, px.
    pub bbox_px: [f64; 4],
}

/// A box, however weak. Where a vehicle that is known is expected it may be it, if no track has it.
#[derive(Clone, Copy, Debug)]
pub struct BoxSighting {
    /// Box, px.
    pub bbox_px: [f64; 4],
    /// Detector's score, 0–1.
    pub score: f64,
    /// What the detector calls it.
    pub class: VehicleClass,
    /// Left, top, right, bottom: the picture ends there.
    pub cut: [bool; 4],
    /// Left, top, right, bottom: another vehicle begins there.
    pub hidden: [bool; 4],
    /// Position in its frame's list of cars; none of a box that is too weak to say that something is a vehicle.
    pub car: Option<usize>,
    /// Nobody looked: it is where it was.
    pub held: bool,
}

impl BoxSighting {
    /// Whether the detector is sure of it.
    pub(crate) fn is_sure(&self) -> bool {
        self.car.is_some()
    }

    /// Left, top, right, bottom: the box ends there and what it shows does not.
    pub(crate) fn goes_on(&self) -> [bool; 4] {
        either(self.cut, self.hidden)
    }
}

fn either(a: [bool; 4], b: [bool; 4]) -> [bool; 4] {
    std::array::from_fn(|i| a[i] || b[i])
}

/// How large a vehicle is.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Length, width, height, m.
    pub dims_m: Vector3<f64>,
    /// Their covariance.
    pub covariance: Matrix3<f64>,
}

/// A vehicle on the ground, by its box.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// Where it stands; the heading may be turned by π.
    pub pose: GroundPose,
    /// Covariance of (x, y, heading), m and rad.
    pub covariance: Matrix3<f64>,
    /// Length, width, height and their sds, m.
    pub dims_m: [Vector3<f64>; 2],
}

/// What is known of a vehicle that is expected somewhere.
#[derive(Clone, Copy, Debug)]
pub struct ExpectedVehicle {
    /// Kind of vehicle.
    pub class: VehicleClass,
    /// Length, width, height, m, of a vehicle that is no car.
    pub dims_m: Option<Vector3<f64>>,
    /// Shape coefficients of a car.
    pub shape: Shape,
    /// Its heading, or that turned by π, rad.
    pub heading_rad: f64,
    /// Its sd, rad; π/2 where nothing is known of it, nor of its size.
    pub heading_sd_rad: f64,
}

/// All cars fitted in one frame; a frame without cars is one too.
#[derive(Clone, Debug)]
pub struct FrameMeasurements {
    /// Which frame.
    pub stamp: FrameStamp,
    /// Whether anybody looked: otherwise only what is held is known of the frame, and no track misses its car.
    pub looked: bool,
    /// Its cars.
    pub cars: Vec<CarMeasurement>,
    /// Those that are held.
    pub held: Vec<HeldCar>,
    /// Those that were seen again so soon after a look that nobody measured them: their tracks want no other box.
    pub seen_again: Vec<SeenAgain>,
    /// All its boxes, those of too low a score to count among them; none where nothing is known of any vehicle yet.
    pub boxes: Vec<BoxSighting>,
}

impl FrameMeasurements {
    /// A frame that was looked at, in which nothing is held.
    #[must_use]
    pub fn seen(stamp: FrameStamp, cars: Vec<CarMeasurement>) -> Self {
        Self { stamp, looked: true, cars, held: Vec::new(), seen_again: Vec::new(), boxes: Vec::new() }
    }
}

/// A measurement as a track keeps it.
#[derive(Clone, Debug)]
pub(crate) struct Sighting {
    /// Counts the frames that the tracker was given.
    pub frame: usize,
    pub time_s: f64,
    pub pose: Vector3<f64>,
    pub covariance: Matrix3<f64>,
    pub bbox_px: [f64; 4],
    pub score: f64,
    /// Position in its frame's list of cars; none of a weak box.
    pub car: Option<usize>,
    /// Pose and covariance are those of an earlier look.
    pub held: bool,
    /// The pose is what the box says: it has an axis, but no front.
    pub from_box: bool,
    /// Called a car, without the keypoints of one.
    pub lacks_keypoints: bool,
    /// Left, top, right, bottom: the picture ends there.
    pub cut: [bool; 4],
    /// Left, top, right, bottom: another vehicle begins there.
    pub hidden: [bool; 4],
}

impl Sighting {
    /// Left, top, right, bottom: the box ends there and the vehicle does not.
    pub(crate) fn goes_on(&self) -> [bool; 4] {
        either(self.cut, self.hidden)
    }

    pub(crate) fn by_box(seen: &BoxSighting, placed: &Placed, frame: usize, time_s: f64) -> Self {
        let Placed { pose, covariance, .. } = *placed;
        Self {
            frame,
            time_s,
            pose: Vector3::new(pose.x_m, pose.y_m, pose.heading_rad),
            covariance,
            bbox_px: seen.bbox_px,
            score: seen.score,
            car: seen.car,
            held: false,
            from_box: true,
            lacks_keypoints: false,
            cut: seen.cut,
            hidden: seen.hidden,
        }
    }
}

/// One vehicle over time.
#[derive(Clone, Debug)]
pub struct Track {
    /// From 1, by first frame, then by x.
    pub id: u64,
    /// Kind of vehicle, by the scores of all its sightings.
    pub class: VehicleClass,
    /// Length, width, height, m, of a vehicle that is no car.
    pub dims_m: Option<Vector3<f64>>,
    /// Their covariance, where its way and its boxes tell it.
    pub dims_covariance: Option<Matrix3<f64>>,
    /// A state for every frame from the first to the last in which it was seen.
    pub states: Vec<TrackState>,
    /// Its shape: all views fused, what was known before counted once.
    pub shape: ShapeBelief,
}

/// A track at one frame.
#[derive(Clone, Debug)]
pub struct TrackState {
    /// Which frame.
    pub stamp: FrameStamp,
    /// Seen in this frame, or filled in.
    pub observed: bool,
    /// Seen only in that nothing changed there since an earlier look.
    pub held: bool,
    /// Smoothed pose.
    pub pose: GroundPose,
    /// sd of x, y (m) and heading (rad).
    pub pose_sd: Vector3<f64>,
    /// Speed along the heading; negative when reversing.
    pub speed_mps: f64,
    /// sd of the speed.
    pub speed_sd_mps: f64,
    /// Box, px, where observed.
    pub bbox_px: Option<[f64; 4]>,
    /// Detector's score; 0 where not observed.
    pub score: f64,
    /// Position of the car in its frame's list, where observed; none where a weak box showed it.
    pub car: Option<usize>,
    /// Called a car, without the keypoints of one.
    pub lacks_keypoints: bool,
}
