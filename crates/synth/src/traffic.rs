//! Manoeuvres along an aisle between two rows of parking bays, and a check whether cars touch.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector2;
use roadplane_base::{GroundPose, wrap_angle};

use crate::Rng;
use crate::trajectory::{CarState, Drive, Leg, Piece, reach};

/// Width of a parking bay, m.
pub(crate) const BAY_M: f64 = 2.7;
/// Length of a parking bay, m.
pub(crate) const BAY_LENGTH_M: f64 = 5.2;
/// Width of the aisle between the two rows of bays, m.
const AISLE_M: f64 = 7.0;
/// Distance between the middle of the aisle and a moving car, m. Cars drive on the right.
const LANE_M: f64 = 1.4;
/// Radius of the discs that represent a car in the collision check, m.
const DISC_RADIUS_M: f64 = 1.05;
/// Positions of the discs along the car, relative to the car's origin, m.
const DISC_OFFSETS_M: [f64; 3] = [-1.5, 0.0, 1.5];
/// Time between two collision checks, s.
const CHECK_S: f64 = 0.2;
/// Lateral distance between the start and the end of a U-turn, m.
const U_TURN_OFFSET_M: f64 = 12.0;

/// Position and direction of the aisle. The aisle's frame has x along the aisle and y to the left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Aisle {
    pub origin: Vector2<f64>,
    pub heading: f64,
}

/// A parking bay: its number along the aisle, and its side (+1 left, −1 right).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bay {
    pub number: i32,
    pub side: i32,
}

impl Aisle {
    /// Converts a pose from the aisle's frame to the world frame (m, rad).
    pub(crate) fn pose(&self, x: f64, y: f64, heading: f64) -> GroundPose {
        let (sin, cos) = self.heading.sin_cos();
        GroundPose {
            x_m: self.origin.x + cos * x - sin * y,
            y_m: self.origin.y + sin * x + cos * y,
            heading_rad: wrap_angle(self.heading + heading),
        }
    }

    /// Returns the pose of a car that is parked in a bay. The car's front is away from the aisle, or towards the aisle
    /// if `backed_in` is true.
    pub(crate) fn bay_pose(&self, bay: Bay, backed_in: bool) -> GroundPose {
        let side = f64::from(bay.side);
        let heading = side * FRAC_PI_2 + if backed_in { PI } else { 0.0 };
        self.pose(bay_x(bay), side * (AISLE_M + BAY_LENGTH_M) / 2.0, heading)
    }
}

fn bay_x(bay: Bay) -> f64 {
    (f64::from(bay.number) + 0.5) * BAY_M
}

/// A manoeuvre of a car in a clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Manoeuvre {
    Through,
    Halt,
    TurnOff,
    UTurn,
    Park(Bay),
    ParkBackwards(Bay),
    LeaveBackwards(Bay),
    LeaveForwards(Bay),
}

/// Draws a random path, speed and time for a manoeuvre in a clip of the given duration. Returns `None` if the car
/// cannot get into the bay.
pub(crate) fn drive(
    manoeuvre: Manoeuvre,
    aisle: &Aisle,
    wheelbase_m: f64,
    seconds: f64,
    rng: &mut Rng,
) -> Option<Drive> {
    let direction = if rng.unit() < 0.5 { 1.0 } else { -1.0 };
    let along = if direction > 0.0 { 0.0 } else { PI };
    let straight = Piece::straight;
    let cruise = rng.uniform(3.0, 6.0);
    let before = 30.0;
    let approach = |x: f64| aisle.pose(x - direction * before, -direction * LANE_M, along);
    let middle = rng.uniform(0.3, 0.7) * seconds;
    let passing = |legs: Vec<Leg>, x: f64, reach_s: f64| {
        let mut drive = Drive::new(legs, wheelbase_m, approach(x), false);
        drive.start_s = middle - reach_s;
        drive
    };
    let at = rng.uniform(-5.0, 5.0);
    match manoeuvre {
        Manoeuvre::Through => {
            Some(passing(vec![Leg::passing(vec![straight(80.0)], cruise)], at, before / cruise))
        }
        Manoeuvre::Halt => {
            let halt = Leg {
                to_rest: true,
                rest_s: rng.uniform(1.5, 3.0),
                ..Leg::passing(vec![straight(before)], cruise)
            };
            let on = Leg { from_rest: true, ..Leg::passing(vec![straight(40.0)], cruise) };
            Some(passing(vec![halt, on], at, before / cruise + 1.5))
        }
        Manoeuvre::TurnOff => {
            let angle = if rng.unit() < 0.5 { FRAC_PI_2 } else { -FRAC_PI_2 };
            let pieces =
                vec![straight(before), Piece::turn(angle, rng.uniform(5.0, 7.0), 3.0), straight(40.0)];
            // The turn is beyond the rows of bays, where the side of the aisle is free.
            let x = direction * 4.5 * BAY_M;
            Some(passing(vec![Leg::passing(pieces, cruise)], x, before / cruise + 2.0))
        }
        Manoeuvre::UTurn => {
            let pieces = vec![straight(before), Piece::u_turn(U_TURN_OFFSET_M, 3.0), straight(40.0)];
            let x = direction * 4.5 * BAY_M;
            Some(passing(vec![Leg::passing(pieces, cruise)], x, before / cruise + 3.5))
        }
        Manoeuvre::Park(bay) | Manoeuvre::ParkBackwards(bay) => {
            let backwards = matches!(manoeuvre, Manoeuvre::ParkBackwards(_));
            let (turn, rest) = bay_turn(bay, direction, wheelbase_m, backwards, rng)?;
            let legs = if backwards {
                let past = Leg {
                    to_rest: true,
                    rest_s: rng.uniform(0.6, 1.2),
                    ..Leg::passing(vec![straight(before)], 3.0)
                };
                let back = Leg {
                    backwards: true,
                    from_rest: true,
                    to_rest: true,
                    parking_from: Some(0),
                    ..Leg::passing(vec![turn, straight(rest)], 1.7)
                };
                vec![past, back]
            } else {
                let pieces = vec![straight(before), turn, straight(rest)];
                vec![Leg { to_rest: true, parking_from: Some(1), ..Leg::passing(pieces, cruise.min(3.6)) }]
            };
            let mut drive = Drive::new(legs, wheelbase_m, aisle.bay_pose(bay, backwards), true);
            drive.start_s = rng.uniform(0.7, 0.95) * seconds - drive.duration_s();
            Some(drive)
        }
        Manoeuvre::LeaveBackwards(bay) | Manoeuvre::LeaveForwards(bay) => {
            let backwards = matches!(manoeuvre, Manoeuvre::LeaveBackwards(_));
            let (turn, rest) = bay_turn(bay, direction, wheelbase_m, !backwards, rng)?;
            let pieces = vec![straight(rest), turn.mirrored()];
            let legs = if backwards {
                let out = Leg {
                    backwards: true,
                    from_rest: true,
                    to_rest: true,
                    rest_s: rng.uniform(0.6, 1.2),
                    ..Leg::passing(pieces, 1.7)
                };
                vec![out, Leg { from_rest: true, ..Leg::passing(vec![straight(50.0)], cruise) }]
            } else {
                let pieces = [pieces, vec![straight(50.0)]].concat();
                vec![Leg { from_rest: true, ..Leg::passing(pieces, cruise) }]
            };
            let mut drive = Drive::new(legs, wheelbase_m, aisle.bay_pose(bay, !backwards), false);
            drive.start_s = rng.uniform(0.08, 0.4) * seconds;
            Some(drive)
        }
    }
}

/// Returns the turn from the aisle into a bay, and the length of the straight piece after the turn, m. Returns `None`
/// if the bay is not deep enough.
///
/// `direction` is the direction of driving along the aisle (+1 or −1). The car drives into the bay forwards, or
/// backwards if `backed_in` is true. The path out of the bay has the mirrored turn.
fn bay_turn(
    bay: Bay,
    direction: f64,
    wheelbase_m: f64,
    backed_in: bool,
    rng: &mut Rng,
) -> Option<(Piece, f64)> {
    let side = f64::from(bay.side);
    let hand = if backed_in { -direction * side } else { direction * side };
    let turn = Piece::turn(hand * FRAC_PI_2, rng.uniform(4.0, 4.8), 2.0);
    let rear = (AISLE_M + BAY_LENGTH_M) / 2.0 + if backed_in { wheelbase_m } else { -wheelbase_m } / 2.0;
    let rest = rear + direction * side * LANE_M - reach(&[turn]).y_m.abs();
    (rest > 0.2).then_some((turn, rest))
}

/// Returns whether two cars touch at any time of a clip. `a` and `b` return the states of the cars at a time, s.
pub(crate) fn touch(a: &dyn Fn(f64) -> CarState, b: &dyn Fn(f64) -> CarState, seconds: f64) -> bool {
    let steps = (seconds / CHECK_S).ceil() as usize;
    (0..=steps).any(|i| {
        let time_s = i as f64 * CHECK_S;
        let (a, b) = (discs(&a(time_s).pose), discs(&b(time_s).pose));
        a.iter().any(|p| b.iter().any(|q| (p - q).norm() < 2.0 * DISC_RADIUS_M))
    })
}

fn discs(pose: &GroundPose) -> [Vector2<f64>; 3] {
    let (sin, cos) = pose.heading_rad.sin_cos();
    DISC_OFFSETS_M.map(|d| Vector2::new(pose.x_m + cos * d, pose.y_m + sin * d))
}
