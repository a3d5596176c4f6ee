//! Trajectories of cars, by a kinematic bicycle model. Steering and speed change no faster than with a human driver.
//!
//! A drive is a list of legs, and the car may rest after a leg. The curvature of a turn rises linearly over a ramp, and
//! falls linearly at the end. The speed follows from a limit on the lateral acceleration. Acceleration from rest and to
//! rest is constant (Rajamani, *Vehicle Dynamics and Control*, §2.2).
//!
//! A path describes the middle of the rear axle. This point moves in the direction of the car's heading. A state
//! describes the car's origin, which is midway between the axles.

use nalgebra::Vector2;
use roadplane_base::{Activity, GroundPose, wrap_angle};

/// Distance between two samples of a path, m.
const STEP_M: f64 = 0.01;
/// Constant acceleration along the path, from rest and to rest, m/s².
const ACCELERATION: f64 = 1.6;
/// Largest lateral acceleration, which limits the speed in turns, m/s².
const LATERAL: f64 = 1.5;
/// Least change of heading of a path piece that is labelled as a U-turn, rad.
const U_TURN: f64 = 150.0 * std::f64::consts::PI / 180.0;
/// Least change of heading of a path piece that is labelled as a turn, rad.
const TURN: f64 = 25.0 * std::f64::consts::PI / 180.0;

/// State of a car at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarState {
    /// Pose of the car's origin.
    pub pose: GroundPose,
    /// Speed of the car's origin, m/s. It is negative when the car reverses.
    pub speed_mps: f64,
    /// Activity of the car.
    pub activity: Activity,
}

impl CarState {
    /// Returns the state of a parked car.
    #[must_use]
    pub fn parked(pose: GroundPose) -> Self {
        Self { pose, speed_mps: 0.0, activity: Activity::Parked }
    }
}

/// A piece of a path: a straight line or a turn.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    length_m: f64,
    /// Change of heading along the piece, rad; positive to the left.
    angle: f64,
    /// Length of each of the two ramps, m. The curvature rises over the first ramp, and falls over the last ramp.
    ramp_m: f64,
}

impl Piece {
    /// Returns a straight piece.
    #[must_use]
    pub fn straight(length_m: f64) -> Self {
        Self { length_m, angle: 0.0, ramp_m: 0.0 }
    }

    /// Returns a turn by `angle` (rad, positive to the left as seen from above).
    ///
    /// The radius is at least `radius_m` everywhere. The curvature rises over the first `ramp_m`, and falls over the
    /// last `ramp_m`.
    #[must_use]
    pub fn turn(angle: f64, radius_m: f64, ramp_m: f64) -> Self {
        Self { length_m: (radius_m * angle.abs() + ramp_m).max(2.0 * ramp_m), angle, ramp_m }
    }

    /// Returns the same piece with its turn in the opposite direction.
    #[must_use]
    pub fn mirrored(self) -> Self {
        Self { angle: -self.angle, ..self }
    }

    /// Returns a half turn to the left. It ends at a lateral distance of `offset_m` from its start.
    #[must_use]
    pub fn u_turn(offset_m: f64, ramp_m: f64) -> Self {
        let (mut low, mut high) = (2.0, 40.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            let wide = reach(&[Self::turn(std::f64::consts::PI, middle, ramp_m)]).y_m > offset_m;
            (low, high) = if wide { (low, middle) } else { (middle, high) };
        }
        Self::turn(std::f64::consts::PI, low, ramp_m)
    }

    /// Returns the heading relative to the start of the piece (rad) and the curvature (1/m). `at` is the distance from
    /// the start, m.
    fn heading_and_curvature_at(&self, at: f64) -> (f64, f64) {
        if self.angle == 0.0 {
            return (0.0, 0.0);
        }
        let (ramp, fall_from) = (self.ramp_m, self.length_m - self.ramp_m);
        let peak = self.angle / fall_from;
        let rise = at.min(ramp).powi(2) / (2.0 * ramp);
        let fall = (at - fall_from).max(0.0).powi(2) / (2.0 * ramp);
        let curvature = peak * (at / ramp).min((self.length_m - at) / ramp).min(1.0);
        (peak * (rise + (at - ramp).max(0.0) - fall), curvature)
    }

    fn activity(&self) -> Activity {
        match self.angle {
            angle if angle.abs() >= U_TURN => Activity::UTurn,
            angle if angle >= TURN => Activity::TurningLeft,
            angle if angle <= -TURN => Activity::TurningRight,
            _ => Activity::Moving,
        }
    }
}

/// A part of a drive without a change between forwards and backwards.
#[derive(Clone, Debug)]
pub struct Leg {
    /// Pieces of the path.
    pub pieces: Vec<Piece>,
    /// Speed where no acceleration limit applies, m/s.
    pub cruise_mps: f64,
    /// Whether the car drives the leg backwards.
    pub backwards: bool,
    /// Whether the car begins the leg at rest.
    pub from_rest: bool,
    /// Whether the car ends the leg at rest.
    pub to_rest: bool,
    /// Duration of the rest after the leg, s.
    pub rest_s: f64,
    /// Index of the first piece with the activity parking. The later pieces have the same activity.
    pub parking_from: Option<usize>,
}

impl Leg {
    /// Returns a forward leg. The car is already moving at the beginning, and is still moving at the end.
    #[must_use]
    pub fn passing(pieces: Vec<Piece>, cruise_mps: f64) -> Self {
        Self {
            pieces,
            cruise_mps,
            backwards: false,
            from_rest: false,
            to_rest: false,
            rest_s: 0.0,
            parking_from: None,
        }
    }
}

/// State of the rear axle at one point of its path.
#[derive(Clone, Copy, Debug)]
struct Sample {
    time_s: f64,
    at: Vector2<f64>,
    heading: f64,
    curvature: f64,
    speed: f64,
    activity: Activity,
}

/// Returns the pose at the end of a path. The path begins at the origin, in the direction of +x.
#[must_use]
pub fn reach(pieces: &[Piece]) -> GroundPose {
    let samples = traced(&Leg::passing(pieces.to_vec(), 1.0));
    let end = samples.last().map_or((Vector2::zeros(), 0.0), |s| (s.at, s.heading));
    GroundPose { x_m: end.0.x, y_m: end.0.y, heading_rad: end.1 }
}

/// Returns samples of a leg that begins at the origin, in the direction of +x, at time 0.
fn traced(leg: &Leg) -> Vec<Sample> {
    let length: f64 = leg.pieces.iter().map(|p| p.length_m).sum();
    let count = (length / STEP_M).ceil().max(2.0) as usize;
    let step = length / count as f64;
    let sign = if leg.backwards { -1.0 } else { 1.0 };
    let mut samples: Vec<Sample> = Vec::with_capacity(count + 1);
    let (mut piece, mut begin, mut turned) = (0, 0.0, 0.0);
    for i in 0..=count {
        let mut local = step * i as f64 - begin;
        while local > leg.pieces[piece].length_m && piece + 1 < leg.pieces.len() {
            begin += leg.pieces[piece].length_m;
            local -= leg.pieces[piece].length_m;
            turned += leg.pieces[piece].angle;
            piece += 1;
        }
        let (relative_heading, curvature) =
            leg.pieces[piece].heading_and_curvature_at(local.min(leg.pieces[piece].length_m));
        let heading = turned + relative_heading;
        let at = samples.last().map_or_else(Vector2::zeros, |last| {
            let middle = 0.5 * (last.heading + heading);
            last.at + Vector2::new(middle.cos(), middle.sin()) * (sign * step)
        });
        let activity = match leg.parking_from {
            Some(from) if piece >= from => Activity::Parking,
            _ if leg.backwards => Activity::Reversing,
            _ => leg.pieces[piece].activity(),
        };
        samples.push(Sample { time_s: 0.0, at, heading, curvature, speed: 0.0, activity });
    }
    time(leg, &mut samples, step);
    samples
}

/// Computes the speeds and times of the samples, and sets the activities `Starting` and `Stopping`.
fn time(leg: &Leg, samples: &mut [Sample], step: f64) {
    let gain = 2.0 * ACCELERATION * step;
    let mut square: Vec<f64> =
        samples.iter().map(|s| leg.cruise_mps.powi(2).min(LATERAL / s.curvature.abs().max(1e-6))).collect();
    let count = square.len();
    for i in 1..count {
        square[i] = square[i].min(square[i - 1] + gain);
    }
    for i in (0..count - 1).rev() {
        square[i] = square[i].min(square[i + 1] + gain);
    }
    for (i, sample) in samples.iter_mut().enumerate() {
        let rise = if leg.from_rest { gain * i as f64 } else { f64::INFINITY };
        let fall = if leg.to_rest { gain * (count - 1 - i) as f64 } else { f64::INFINITY };
        sample.speed = square[i].min(rise).min(fall).sqrt();
        if sample.activity == Activity::Moving && rise.min(fall) <= square[i] {
            sample.activity = if fall < rise { Activity::Stopping } else { Activity::Starting };
        }
    }
    for i in 1..count {
        samples[i].time_s = samples[i - 1].time_s + 2.0 * step / (samples[i].speed + samples[i - 1].speed);
    }
    if leg.backwards {
        samples.iter_mut().for_each(|s| s.speed = -s.speed);
    }
}

/// The motion of a car over time. A drive that begins or ends at speed continues straight on outside its legs.
/// Otherwise the car is at rest before and after the legs.
#[derive(Clone, Debug)]
pub struct Drive {
    legs: Vec<(Leg, Vec<Sample>)>,
    wheelbase_m: f64,
    /// Time in the clip at which the first leg begins, s.
    pub start_s: f64,
}

impl Drive {
    /// Creates a drive from at least one leg. The car's origin is at `pose` at the start of the drive, or at its end if
    /// `at_end` is true.
    #[must_use]
    pub fn new(legs: Vec<Leg>, wheelbase_m: f64, pose: GroundPose, at_end: bool) -> Self {
        let (mut clock, mut here) = (0.0, (Vector2::zeros(), 0.0));
        let mut parts = Vec::with_capacity(legs.len());
        for leg in legs {
            let mut samples = traced(&leg);
            for sample in &mut samples {
                (sample.at, sample.heading) = moved(here, (sample.at, sample.heading));
                sample.time_s += clock;
            }
            if let Some(last) = samples.last() {
                (clock, here) = (last.time_s + leg.rest_s, (last.at, last.heading));
            }
            parts.push((leg, samples));
        }
        let given = if at_end { here } else { (Vector2::zeros(), 0.0) };
        let angle = pose.heading_rad - given.1;
        let rear = Vector2::new(pose.x_m, pose.y_m) - ahead(pose.heading_rad) * (wheelbase_m / 2.0);
        let turned = moved((Vector2::zeros(), angle), given).0;
        for sample in parts.iter_mut().flat_map(|(_, samples)| samples) {
            (sample.at, sample.heading) = moved((rear - turned, angle), (sample.at, sample.heading));
        }
        Self { legs: parts, wheelbase_m, start_s: 0.0 }
    }

    /// Returns the duration of the drive, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.legs.last().and_then(|(leg, s)| Some(s.last()?.time_s + leg.rest_s)).unwrap_or(0.0)
    }

    /// Returns the state of the car at a time of the clip, s.
    #[must_use]
    pub fn at(&self, time_s: f64) -> CarState {
        let clock = time_s - self.start_s;
        let mut resting: Option<&Sample> = None;
        for (number, (leg, samples)) in self.legs.iter().enumerate() {
            let (Some(first), Some(last)) = (samples.first(), samples.last()) else { continue };
            if clock < first.time_s {
                return match resting {
                    Some(before) => self.beyond(before, false, 0.0),
                    None => self.beyond(first, !leg.from_rest, clock - first.time_s),
                };
            }
            if clock <= last.time_s {
                return self.between(samples, clock);
            }
            if number + 1 == self.legs.len() {
                return self.beyond(last, !leg.to_rest, clock - last.time_s);
            }
            resting = Some(last);
        }
        CarState::parked(GroundPose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 })
    }

    /// Interpolates between two samples with constant acceleration. `clock` is the time since the first leg began, s.
    fn between(&self, samples: &[Sample], clock: f64) -> CarState {
        let next = samples.partition_point(|s| s.time_s <= clock).clamp(1, samples.len() - 1);
        let (a, b) = (&samples[next - 1], &samples[next]);
        let (since, step) = (clock - a.time_s, b.time_s - a.time_s);
        let speed = a.speed + (b.speed - a.speed) * since / step;
        let share = (a.speed + speed) * since / ((a.speed + b.speed) * step);
        let mix = |x: f64, y: f64| x + (y - x) * share;
        let at = a.at + (b.at - a.at) * share;
        self.state(at, mix(a.heading, b.heading), speed, mix(a.curvature, b.curvature), a.activity)
    }

    /// Returns the state before the first or after the last sample. If `moving` is true, the car drives straight on;
    /// otherwise the car is at rest.
    fn beyond(&self, sample: &Sample, moving: bool, since_s: f64) -> CarState {
        let speed = if moving { sample.speed } else { 0.0 };
        self.state(
            sample.at + ahead(sample.heading) * (speed * since_s),
            sample.heading,
            speed,
            0.0,
            sample.activity,
        )
    }

    fn state(
        &self,
        rear: Vector2<f64>,
        heading: f64,
        speed: f64,
        curvature: f64,
        activity: Activity,
    ) -> CarState {
        let half = self.wheelbase_m / 2.0;
        let at = rear + ahead(heading) * half;
        let activity = if speed == 0.0 { Activity::Parked } else { activity };
        // The origin moves on a wider circle than the rear axle.
        let speed_mps = speed * 1.0_f64.hypot(curvature * half);
        CarState {
            pose: GroundPose { x_m: at.x, y_m: at.y, heading_rad: wrap_angle(heading) },
            speed_mps,
            activity,
        }
    }
}

fn ahead(heading: f64) -> Vector2<f64> {
    Vector2::new(heading.cos(), heading.sin())
}

/// Transforms a pose from a frame to the parent of the frame. `frame` is the frame's pose in its parent. A pose is a
/// position and a heading.
fn moved(frame: (Vector2<f64>, f64), pose: (Vector2<f64>, f64)) -> (Vector2<f64>, f64) {
    let (sin, cos) = frame.1.sin_cos();
    let (x, y) = (pose.0.x, pose.0.y);
    (frame.0 + Vector2::new(cos * x - sin * y, sin * x + cos * y), frame.1 + pose.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    const WHEELBASE_M: f64 = 2.7;
    const STEP_S: f64 = 0.02;

    fn drives() -> Vec<(&'static str, Drive)> {
        let s = Piece::straight;
        let leg = |pieces, cruise| Leg::passing(pieces, cruise);
        let rest = |pieces, cruise| Leg { to_rest: true, rest_s: 1.0, ..leg(pieces, cruise) };
        let named = vec![
            ("left", vec![leg(vec![s(20.0), Piece::turn(FRAC_PI_2, 6.0, 3.0), s(20.0)], 5.0)]),
            ("u-turn", vec![leg(vec![s(15.0), Piece::u_turn(10.2, 3.0), s(12.0)], 7.0)]),
            ("halt", vec![rest(vec![s(25.0)], 7.0), Leg { from_rest: true, ..leg(vec![s(30.0)], 7.0) }]),
            (
                "park",
                vec![Leg {
                    parking_from: Some(1),
                    ..rest(vec![s(12.0), Piece::turn(-FRAC_PI_2, 4.5, 2.0), s(1.0)], 3.0)
                }],
            ),
            (
                "leave",
                vec![
                    Leg {
                        backwards: true,
                        from_rest: true,
                        ..rest(vec![s(3.0), Piece::turn(FRAC_PI_2, 4.5, 2.0)], 1.8)
                    },
                    Leg { from_rest: true, ..leg(vec![s(20.0)], 4.0) },
                ],
            ),
        ];
        let pose = GroundPose { x_m: 3.0, y_m: -2.0, heading_rad: 0.7 };
        let drive = |legs| Drive { start_s: 1.0, ..Drive::new(legs, WHEELBASE_M, pose, false) };
        named.into_iter().map(|(name, legs)| (name, drive(legs))).collect()
    }

    fn states(drive: &Drive) -> Vec<CarState> {
        let count = ((drive.duration_s() + 2.0) / STEP_S) as usize;
        (0..count).map(|i| drive.at(i as f64 * STEP_S)).collect()
    }

    #[test]
    fn speed_is_the_change_of_position_and_acceleration_is_bounded() {
        for (name, drive) in drives() {
            let at: Vec<_> = states(&drive);
            for three in at.windows(3) {
                let position = |i: usize| Vector2::new(three[i].pose.x_m, three[i].pose.y_m);
                let moved = (position(2) - position(0)).norm() / (2.0 * STEP_S);
                assert!((moved - three[1].speed_mps.abs()).abs() < 0.02, "{name}: {moved} {:?}", three[1]);
                let acceleration = (position(2) - position(1) * 2.0 + position(0)).norm() / STEP_S.powi(2);
                assert!(acceleration < 3.2, "{name}: {acceleration}");
            }
        }
    }

    #[test]
    fn activities_fit_the_motion() {
        let mut met = Vec::new();
        for (name, drive) in drives() {
            for two in states(&drive).windows(2) {
                let turned = wrap_angle(two[1].pose.heading_rad - two[0].pose.heading_rad);
                let (now, after) = (two[0], two[1]);
                assert_eq!(now.activity == Activity::Parked, now.speed_mps == 0.0, "{name}");
                assert_eq!(now.activity == Activity::Reversing, now.speed_mps < 0.0, "{name}");
                match now.activity {
                    Activity::TurningLeft | Activity::UTurn => assert!(turned > -1e-9, "{name}"),
                    Activity::Stopping => assert!(after.speed_mps < now.speed_mps, "{name}"),
                    Activity::Starting => assert!(after.speed_mps >= now.speed_mps, "{name}"),
                    _ => {}
                }
                if !met.contains(&now.activity) {
                    met.push(now.activity);
                }
            }
        }
        assert_eq!(met.len(), 8, "all but turning right: {met:?}");
    }

    #[test]
    fn paths_end_where_they_should() {
        let end = reach(&[Piece::u_turn(10.2, 3.0)]);
        assert!((end.y_m - 10.2).abs() < 1e-3 && end.x_m.abs() < 1e-3 && (end.heading_rad - PI).abs() < 1e-9);
        let pose = GroundPose { x_m: 1.0, y_m: 2.0, heading_rad: 0.5 };
        let pieces = vec![Piece::straight(9.0), Piece::turn(-1.2, 5.0, 3.0)];
        let drive =
            Drive::new(vec![Leg { to_rest: true, ..Leg::passing(pieces, 3.0) }], WHEELBASE_M, pose, true);
        let rest = drive.at(1e3);
        assert!((rest.pose.x_m - 1.0).abs() < 1e-9 && (rest.pose.y_m - 2.0).abs() < 1e-9);
        assert!(wrap_angle(rest.pose.heading_rad - 0.5).abs() < 1e-9);
        assert_eq!(rest, drive.at(2e3));
    }
}
