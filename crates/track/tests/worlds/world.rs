//! Cars on a plane under a camera, and the measurements that a detector with a pose fit makes of them.

use nalgebra::{Matrix2, Matrix3, Matrix6, Point3, Vector2, Vector3};
use roadplane_base::{Camera, FrameStamp, GroundPlane, GroundPose, Shape, VehicleClass};
use roadplane_synth::Rng;
use roadplane_track::{
    CarMeasurement, Detection, FrameMeasurements, ShapeEstimate, Track, TrackOptions, Tracker,
};

/// How well the keypoints of cars usually fit.
pub const GOOD_FIT: f64 = 0.018;
/// How well keypoints that a net finds in other objects usually fit.
const BAD_FIT: f64 = 0.05;

/// Pose of a car at a time (s); `None` while it is absent.
pub type Path = Box<dyn Fn(f64) -> Option<GroundPose>>;

/// Returns a pose at x, y (m) with a heading (rad).
pub fn pose(x_m: f64, y_m: f64, heading_rad: f64) -> GroundPose {
    GroundPose { x_m, y_m, heading_rad }
}

/// Returns the path of a parked car: x, y (m) and heading (rad).
pub fn parked(x_m: f64, y_m: f64, heading_rad: f64) -> Path {
    Box::new(move |_| Some(pose(x_m, y_m, heading_rad)))
}

/// Returns a straight path from a pose at a constant speed, m/s.
pub fn straight(from: GroundPose, speed_mps: f64) -> Path {
    let (sin, cos) = from.heading_rad.sin_cos();
    Box::new(move |t| {
        Some(pose(from.x_m + speed_mps * t * cos, from.y_m + speed_mps * t * sin, from.heading_rad))
    })
}

/// The quality of detections and poses.
#[derive(Clone)]
pub struct Seeing {
    /// Sd of the position across the line of sight at 20 m, m. It grows with the distance.
    pub across_m: f64,
    /// Sd of the position along the line of sight at 20 m, m. It grows with the square of the distance.
    pub along_m: f64,
    /// Sd of the heading, rad.
    pub heading_sd: f64,
    /// Share of the variance that a car keeps for the whole clip, 0–1.
    pub bias: f64,
    /// Ratio of the true sd of a pose to that of its covariance.
    pub sd_ratio: f64,
    /// Sd of each edge of a box, px.
    pub box_sd_px: f64,
    /// Probability that a car is missed in a frame, 0–1.
    pub missed: f64,
    /// Probability of a false alarm in a frame, 0–1.
    pub false_alarms: f64,
    /// Probability that front and back are confused in a frame, 0–1.
    pub flipped: f64,
    /// Share of a car's box, 0–1. A nearer car hides it if its box covers more than that. A value above 1 means that no
    /// car is ever hidden.
    pub hidden: f64,
}

impl Seeing {
    /// Returns perfect quality: no noise, no misses and no false alarms.
    pub fn perfect() -> Self {
        Self {
            across_m: 0.0,
            along_m: 0.0,
            heading_sd: 0.0,
            bias: 0.0,
            sd_ratio: 1.0,
            box_sd_px: 0.0,
            missed: 0.0,
            false_alarms: 0.0,
            flipped: 0.0,
            hidden: 2.0,
        }
    }

    /// Returns the usual quality.
    pub fn usual() -> Self {
        Self {
            across_m: 0.1,
            along_m: 0.3,
            heading_sd: 0.08,
            bias: 0.4,
            sd_ratio: 1.0,
            box_sd_px: 1.0,
            missed: 0.05,
            false_alarms: 0.02,
            flipped: 0.03,
            hidden: 0.5,
        }
    }
}

/// A simulated world.
pub struct World {
    /// Path of each car.
    pub cars: Vec<Path>,
    /// Quality of detections and poses.
    pub seeing: Seeing,
    /// Time of each frame, s.
    pub times_s: Vec<f64>,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// The input of the tracker, with the truth.
pub struct Seen {
    /// The input of the tracker, one element per frame.
    pub frames: Vec<FrameMeasurements>,
    /// The true car of each measurement, per frame; `None` for a false alarm.
    pub owners: Vec<Vec<Option<usize>>>,
}

/// Returns the camera and the ground plane below it.
pub fn camera() -> (Camera, GroundPlane) {
    let camera = Camera::pinhole(1400.0, Vector2::new(959.5, 539.5));
    (camera, GroundPlane::from_tilt_roll_height(0.35, 0.0, 9.0))
}

/// Returns the times (s) of frames at a constant rate (frames per second), over a duration in s.
pub fn times(seconds: f64, rate: f64) -> Vec<f64> {
    (0..(seconds * rate).round() as usize).map(|i| i as f64 / rate).collect()
}

/// Returns the box of a car of 4.5 × 1.8 × 1.5 m, px; `None` if it is not fully in the picture.
pub fn box_of(car: &GroundPose) -> Option<[f64; 4]> {
    body_box(car, &Vector3::new(4.5, 1.8, 1.5))
        .filter(|[x0, y0, x1, y1]| *x0 > 0.0 && *y0 > 0.0 && *x1 < 1920.0 && *y1 < 1080.0)
}

/// Returns the box of a body of this length, width and height (m), px. It may extend beyond the picture.
pub fn body_box(car: &GroundPose, dims_m: &Vector3<f64>) -> Option<[f64; 4]> {
    let (camera, plane) = camera();
    let camera_from_car = plane.camera_from_world() * car.world_from_car();
    let mut bbox = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for (x, y, z) in (0..8).map(|i| (f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))) {
        let corner = camera_from_car * Point3::from(Vector3::new(x - 0.5, y - 0.5, z).component_mul(dims_m));
        let pixel = camera.pixel_from_camera(&corner.coords)?;
        bbox = [bbox[0].min(pixel.x), bbox[1].min(pixel.y), bbox[2].max(pixel.x), bbox[3].max(pixel.y)];
    }
    Some(bbox)
}

/// Returns the square root of the covariance of (x, y, heading) at a car's position.
fn noise_root(car: &GroundPose, seeing: &Seeing) -> Matrix3<f64> {
    let away = Vector2::new(car.x_m, car.y_m);
    let along = away / away.norm();
    let grown = (away.norm() / 20.0).powi(2).max(0.2);
    let axes = Matrix2::from_columns(&[Vector2::new(-along.y, along.x), along]);
    let spread =
        axes * Matrix2::from_diagonal(&Vector2::new(seeing.across_m * grown.sqrt(), seeing.along_m * grown));
    let mut root = Matrix3::zeros();
    root.fixed_view_mut::<2, 2>(0, 0).copy_from(&spread);
    root[(2, 2)] = seeing.heading_sd;
    root
}

impl World {
    /// Creates a world.
    pub fn new(cars: Vec<Path>, seeing: Seeing, times_s: Vec<f64>, seed: u64) -> Self {
        Self { cars, seeing, times_s, seed }
    }

    /// Simulates the measurements of all frames.
    pub fn see(&self) -> Seen {
        let seeing = &self.seeing;
        let mut random = Rng::new(self.seed);
        let biases: Vec<Vector3<f64>> =
            self.cars.iter().map(|_| Vector3::from_fn(|_, _| random.normal())).collect();
        let mut seen = Seen { frames: Vec::new(), owners: Vec::new() };
        for (index, &time_s) in self.times_s.iter().enumerate() {
            let poses: Vec<Option<GroundPose>> = self.cars.iter().map(|path| path(time_s)).collect();
            let boxes: Vec<Option<[f64; 4]>> = poses.iter().map(|p| p.as_ref().and_then(box_of)).collect();
            let mut cars = Vec::new();
            let mut owners = Vec::new();
            for (k, pose) in poses.iter().enumerate() {
                let draw = Vector3::from_fn(|_, _| random.normal());
                let jitter: [f64; 4] = std::array::from_fn(|_| seeing.box_sd_px * random.normal());
                let (lost, turned) = (random.unit() < seeing.missed, random.unit() < seeing.flipped);
                let (Some(pose), Some(bbox)) = (pose, boxes[k]) else { continue };
                let covered = (0..poses.len()).filter(|&j| j != k).any(|j| {
                    let nearer = poses[j].is_some_and(|other| other.y_m < pose.y_m);
                    nearer && boxes[j].is_some_and(|b| share_covered(&bbox, &b) > seeing.hidden)
                });
                if lost || covered {
                    continue;
                }
                let root = noise_root(pose, seeing);
                let error = root * (biases[k] * seeing.bias.sqrt() + draw * (1.0 - seeing.bias).sqrt());
                let turn = if turned { std::f64::consts::PI } else { 0.0 };
                let covariance =
                    root * root.transpose() / seeing.sd_ratio.powi(2) + Matrix3::identity() * 1e-12;
                let measured = GroundPose {
                    x_m: pose.x_m + error.x,
                    y_m: pose.y_m + error.y,
                    heading_rad: roadplane_base::wrap_angle(pose.heading_rad + error.z + turn),
                };
                let bbox_px = std::array::from_fn(|i| bbox[i] + jitter[i]);
                let seen =
                    Detection { car: Some(cars.len()), ..Detection::uncut(bbox_px, 0.8, VehicleClass::Car) };
                cars.push(CarMeasurement {
                    shape: ShapeEstimate { mean: Shape::repeat(0.3), information: Matrix6::identity() * 3.0 },
                    from_box: false,
                    fit_rms_share: Some(GOOD_FIT),
                    ..CarMeasurement::by_box(measured, covariance, seen)
                });
                owners.push(Some(k));
            }
            let (alarm, x, y, turn) = (random.unit(), random.unit(), random.unit(), random.unit());
            let place = pose(30.0 * (x - 0.5), 15.0 + 30.0 * y, 6.0 * turn);
            if let (true, Some(bbox_px)) = (alarm < seeing.false_alarms, box_of(&place)) {
                let root = noise_root(&place, seeing);
                let covariance = root * root.transpose() + Matrix3::identity() * 1e-12;
                let seen =
                    Detection { car: Some(cars.len()), ..Detection::uncut(bbox_px, 0.4, VehicleClass::Car) };
                cars.push(CarMeasurement {
                    from_box: false,
                    fit_rms_share: Some(BAD_FIT),
                    ..CarMeasurement::by_box(place, covariance, seen)
                });
                owners.push(None);
            }
            let stamp = FrameStamp { index: index as u64, pts_nanos: (time_s * 1e9).round() as i64 };
            seen.frames.push(FrameMeasurements::seen(stamp, cars));
            seen.owners.push(owners);
        }
        seen
    }

    /// Returns the true pose of a car at a frame.
    pub fn truth(&self, car: usize, stamp: &FrameStamp) -> Option<GroundPose> {
        (self.cars[car])(stamp.time_s())
    }
}

/// Returns the share of a box that another box covers, 0–1.
fn share_covered(own: &[f64; 4], other: &[f64; 4]) -> f64 {
    let w = (own[2].min(other[2]) - own[0].max(other[0])).max(0.0);
    let h = (own[3].min(other[3]) - own[1].max(other[1])).max(0.0);
    w * h / ((own[2] - own[0]) * (own[3] - own[1]))
}

/// Returns the tracks of these frames, with default settings and no scene.
pub fn track(frames: &[FrameMeasurements]) -> Vec<Track> {
    let mut tracker = Tracker::new(TrackOptions::default());
    frames.iter().for_each(|frame| tracker.push(frame));
    tracker.finish(&()).tracks
}

/// Returns the car that each track follows: the one that has nine tenths of its detections.
pub fn owners(tracks: &[Track], seen: &Seen) -> Vec<Option<usize>> {
    tracks
        .iter()
        .map(|track| {
            let cars: Vec<Option<usize>> = track
                .states
                .iter()
                .filter_map(|state| Some(seen.owners[state.stamp.index as usize][state.car?]))
                .collect();
            let most =
                cars.iter().flatten().max_by_key(|k| cars.iter().filter(|c| **c == Some(**k)).count())?;
            let share = cars.iter().filter(|c| **c == Some(*most)).count() as f64 / cars.len() as f64;
            (share >= 0.9).then_some(*most)
        })
        .collect()
}

/// Asserts that every car has exactly one track and that there are no others. Returns the track of each car.
pub fn assert_one_track_each(tracks: &[Track], seen: &Seen, cars: usize) -> Vec<usize> {
    let owners = owners(tracks, seen);
    let mut found: Vec<usize> = owners.iter().flatten().copied().collect();
    found.sort_unstable();
    assert_eq!(found, (0..cars).collect::<Vec<_>>(), "cars that have a track");
    assert_eq!(tracks.len(), cars, "tracks that follow no car");
    (0..cars).map(|k| owners.iter().position(|o| *o == Some(k)).unwrap()).collect()
}
