//! Estimates the focal length from parallel cars: cars side by side that point the same way.
//!
//! The keypoints show how a car is turned relative to the ray to it. The direction of that ray depends on the focal
//! length. If the focal length is too short, the rays spread and parallel cars appear as a fan.
//!
//! Cars of a site with about the same direction are taken for parallel. The tolerance covers the uncertainty of each
//! car and the curvature of streets, since a car further along points elsewhere. Each direction (also the opposite one,
//! or across) has its own mean. So an error that all cars with one aspect share does no harm.

use nalgebra::{DMatrix, DVector};
use roadplane_base::{CameraParams, Factor, GroundPose, StudentT};

use crate::LinkId;

/// The heading of a car as a function of the focal length: `heading + fan · (1 − solved focal / focal)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarHeading {
    /// Identifier of the car.
    pub link: LinkId,
    /// Heading on the ground with the camera of the solve, rad.
    heading: f64,
    /// Derivative of the heading by log focal length with the horizon fixed, rad.
    fan: f64,
    /// Focal length of the solve, px.
    focal_px: f64,
    /// Position (x, y) on the ground, m.
    place: [f64; 2],
    /// Sd of the heading for a given camera, rad.
    sd: f64,
}

/// The result from parallel cars.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parallel {
    /// Factor on the camera's focal length.
    pub factor: Factor,
    /// Number of cars that were used.
    pub cars: usize,
}

/// Largest difference of heading between a car and the first car of its direction, rad.
const SAME_WAY: f64 = 0.175;
/// Least number of cars of a direction; two cars may be parallel by chance.
const LEAST_CARS: usize = 3;
/// Sd of the heading of parallel cars, rad (1.5°): their own turn and the error of the net.
const TURN_SD: f64 = 0.026;
/// Sd of the curvature of streets, rad/m: a radius of 500 m. This is an estimate: city streets are straight, and
/// motorways curve by less.
const BEND_SD: f64 = 0.002;
/// Sd of the error that the net itself causes by turning parallel cars into a fan, as a share of 1 / focal length.
///
/// All cars of a site have it in common. The value is an estimate; on calibrated cameras it is 7 % ± 6 %.
const SHARED_FAN: f64 = 0.05;
/// Number of rounds of weighting cars by how well they fit.
const ROUNDS: usize = 20;
/// Error model of a car's heading.
const SCATTER: StudentT = StudentT { dimensions: 1.0 };

impl CarHeading {
    /// Computes the heading of a car that was solved with the camera `params`. `sd` is the heading's sd for a given
    /// camera, rad.
    ///
    /// `None` where the car is not in front of the camera.
    #[must_use]
    pub fn new(link: LinkId, params: &CameraParams, pose: &GroundPose, sd: f64) -> Option<Self> {
        let focal_px = params.focal_px();
        let place = nalgebra::Point3::new(pose.x_m, pose.y_m, 0.0);
        let seen = params.plane().camera_from_world() * place;
        let pixel = (seen.z > 0.0).then(|| focal_px * seen.coords.xy() / seen.z)?;
        let azimuth = |log_change: f64| {
            let focal = focal_px * f64::exp(log_change);
            let tilt = (focal_px * params.tilt.tan() / focal).atan();
            let plane = CameraParams { tilt, ..*params }.plane();
            let ray = plane.camera_from_world().rotation.inverse() * pixel.push(focal);
            ray.x.atan2(ray.y)
        };
        // Step of the numerical derivative, in log focal length.
        const STEP: f64 = 0.02;
        let fan = (azimuth(-STEP) - azimuth(STEP)) / (2.0 * STEP);
        let is_sound = [fan, pose.heading_rad, sd].iter().all(|v| v.is_finite()) && sd >= 0.0;
        let heading = pose.heading_rad;
        is_sound.then_some(Self { link, heading, fan, focal_px, place: [pose.x_m, pose.y_m], sd })
    }
}

/// Estimates the focal length from cars of a site that point the same way.
///
/// `log_focal_sd` is the sd of log focal length from the cars' poses. `None` where there are too few cars, or all of
/// them lie in one viewing direction. `None` also where the poses have the smaller sd: both use the same keypoints.
#[must_use]
pub fn parallel(headings: &[CarHeading], log_focal_sd: f64) -> Option<Parallel> {
    let mut open = of_each_car(headings);
    let mut system = System::default();
    while let Some(first) = open.first().copied() {
        let is_same_way = |other: &CarHeading| turn(first.heading, other.heading).abs() < SAME_WAY;
        let (group, rest): (Vec<_>, Vec<_>) = open.into_iter().partition(is_same_way);
        open = rest;
        if group.len() >= LEAST_CARS {
            system.add(&first, &group);
        }
    }
    let [inverse_focal, sd] = system.solve()?;
    let sd = sd.hypot(SHARED_FAN * inverse_focal);
    let is_determined = inverse_focal > 0.0 && sd < log_focal_sd * inverse_focal;
    is_determined.then_some(Parallel {
        factor: Factor::InverseFocal { per_px: inverse_focal, sd },
        cars: system.rows.len(),
    })
}

/// Returns the view with the least sd of each car, ordered by sd.
///
/// More views of a moving car would show how it turns.
fn of_each_car(headings: &[CarHeading]) -> Vec<CarHeading> {
    let mut cars = headings.to_vec();
    cars.sort_by(|a, b| a.link.cmp(&b.link).then(a.sd.total_cmp(&b.sd)));
    cars.dedup_by_key(|car| car.link);
    cars.sort_by(|a, b| a.sd.total_cmp(&b.sd).then(a.link.cmp(&b.link)));
    cars
}

/// Returns the shortest turn from one direction to another, rad.
fn turn(from: f64, to: f64) -> f64 {
    let angle = to - from;
    angle.sin().atan2(angle.cos())
}

/// A linear least-squares system in 1 / focal length.
///
/// Each heading is the direction of its group plus the curvature of its street times the position along the street. The
/// focal length is common to all.
#[derive(Default)]
struct System {
    /// Number of groups, one per direction.
    groups: usize,
    /// One row per car.
    rows: Vec<Row>,
}

/// The equation of one car.
struct Row {
    /// Index of the car's group.
    group: usize,
    /// Position along the street relative to the group's first car, m.
    along: f64,
    /// Heading for an infinite focal length, relative to the heading of the group's first car, rad.
    heading: f64,
    /// Derivative of the heading by 1 / focal length, rad·px.
    fan: f64,
    /// Variance of the heading, rad².
    variance: f64,
}

impl System {
    /// Adds a group of parallel cars; `first` defines its direction and origin.
    fn add(&mut self, first: &CarHeading, group: &[CarHeading]) {
        let (sin, cos) = first.heading.sin_cos();
        self.rows.extend(group.iter().map(|car| Row {
            group: self.groups,
            along: cos * (car.place[0] - first.place[0]) + sin * (car.place[1] - first.place[1]),
            heading: turn(first.heading, car.heading) + car.fan,
            fan: car.fan * car.focal_px,
            variance: TURN_SD * TURN_SD + car.sd * car.sd,
        }));
        self.groups += 1;
    }

    /// Returns 1 / focal length and its sd, 1/px; `None` where the system has no solution.
    fn solve(&self) -> Option<[f64; 2]> {
        let unknowns = 1 + 2 * self.groups;
        let by = |row: &Row| {
            let mut by = DVector::<f64>::zeros(unknowns);
            by[0] = row.fan;
            by[1 + 2 * row.group] = 1.0;
            by[2 + 2 * row.group] = row.along;
            by
        };
        let mut weights = vec![1.0; self.rows.len()];
        let mut found = None;
        for _ in 0..ROUNDS {
            let mut information = DMatrix::<f64>::zeros(unknowns, unknowns);
            let mut sum = DVector::<f64>::zeros(unknowns);
            for group in 0..self.groups {
                information[(2 + 2 * group, 2 + 2 * group)] = 1.0 / (BEND_SD * BEND_SD);
            }
            for (row, weight) in self.rows.iter().zip(&weights) {
                let (by, weight) = (by(row), weight / row.variance);
                sum += weight * row.heading * &by;
                information += weight * &by * by.transpose();
            }
            // Scales all unknowns to the same size.
            let scale = information.diagonal().map(|v| 1.0 / v.sqrt());
            let scaled =
                DMatrix::from_fn(unknowns, unknowns, |r, c| information[(r, c)] * scale[r] * scale[c]);
            let factor = scaled.cholesky()?;
            let solution = factor.solve(&sum.component_mul(&scale)).component_mul(&scale);
            let sd = scale[0] * factor.inverse()[(0, 0)].sqrt();
            for (row, weight) in self.rows.iter().zip(&mut weights) {
                *weight =
                    SCATTER.weight((row.heading - by(row).dot(&solution)).powi(2) / row.variance).min(1.0);
            }
            found = Some([solution[0], sd]);
        }
        found.filter(|found| found.iter().all(|v| v.is_finite()))
    }
}
