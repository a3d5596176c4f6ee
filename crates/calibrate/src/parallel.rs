//! Cars that stand or drive side by side point the same way: a witness for the focal length.
//!
//! How a car is turned is seen against the ray to it, and where that ray points follows from the focal length. Too short a one
//! spreads the rays, and parallel cars come out as a fan. Cars of one direction of a place are taken for parallel, but for how well
//! each is seen, and for streets that bend, as a car further along points elsewhere. Directions of their own (the other way, across)
//! count for themselves, so what all cars of one aspect are wrong by together does no harm.

use nalgebra::{DMatrix, DVector};
use roadplane_base::{CameraParams, Factor, GroundPose, StudentT};

use crate::LinkId;

/// How a car is turned, as a function of the focal length: `heading + fan · (1 − solved focal / focal)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarHeading {
    /// Which car.
    pub link: LinkId,
    /// On the ground, before the camera it was solved with, rad.
    heading: f64,
    /// How fast the heading grows with log focal where the horizon stays, rad.
    fan: f64,
    /// The focal length it was solved with, px.
    focal_px: f64,
    /// Where it stands, m.
    place: [f64; 2],
    /// sd of the heading before a camera that is known, rad.
    sd: f64,
}

/// What parallel cars say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parallel {
    /// Of the camera.
    pub factor: Factor,
    /// Cars that it rests on.
    pub cars: usize,
}

/// Of a direction, so far to either side, rad.
const SAME_WAY: f64 = 0.175;
/// Cars that a direction needs: two are parallel to something else.
const LEAST_CARS: usize = 3;
/// How far cars beside each other are off being parallel, and how far the net is off, rad (sd): 1.5°.
const TURN_SD: f64 = 0.026;
/// Bend of streets, rad/m (sd): a radius of 500 m (estimate: city streets are straight, motorways bend by less).
const BEND_SD: f64 = 0.002;
/// How much of a fan the net makes of parallel cars by itself, as a share of what it sees (sd): it has that in common for all cars of a
/// place (estimate; on calibrated cameras 7 % ± 6 %).
const SHARED_FAN: f64 = 0.05;
/// Rounds of weighing cars by how well they fit.
const ROUNDS: usize = 20;
const SCATTER: StudentT = StudentT { dimensions: 1.0 };

impl CarHeading {
    /// Of a car that was solved before a camera, its heading known to `sd` rad were the camera known. `None` where the car is not in
    /// front of the camera.
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
        const STEP: f64 = 0.02;
        let fan = (azimuth(-STEP) - azimuth(STEP)) / (2.0 * STEP);
        let is_sound = [fan, pose.heading_rad, sd].iter().all(|v| v.is_finite()) && sd >= 0.0;
        let heading = pose.heading_rad;
        is_sound.then_some(Self { link, heading, fan, focal_px, place: [pose.x_m, pose.y_m], sd })
    }
}

/// What cars of a place that point the same way say of the focal length; `None` where they are few or beside each other, or where the
/// cars' poses tell its logarithm to `log_focal_sd` already and that is better: both are of the same keypoints.
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

/// The best known view of each car, the best known car first: more views of one that drives say how it turns.
fn of_each_car(headings: &[CarHeading]) -> Vec<CarHeading> {
    let mut cars = headings.to_vec();
    cars.sort_by(|a, b| a.link.cmp(&b.link).then(a.sd.total_cmp(&b.sd)));
    cars.dedup_by_key(|car| car.link);
    cars.sort_by(|a, b| a.sd.total_cmp(&b.sd).then(a.link.cmp(&b.link)));
    cars
}

/// From one direction to another, rad, the short way.
fn turn(from: f64, to: f64) -> f64 {
    let angle = to - from;
    angle.sin().atan2(angle.cos())
}

/// Headings = direction of their group + bend of its street · place along it, all of the same focal length: linear in
/// 1 / focal.
#[derive(Default)]
struct System {
    groups: usize,
    rows: Vec<Row>,
}

/// What one car adds.
struct Row {
    group: usize,
    /// Place along the street, m.
    along: f64,
    /// Heading were the focal length infinite, against the group's first, rad.
    heading: f64,
    /// Its change by 1 / focal, rad·px.
    fan: f64,
    variance: f64,
}

impl System {
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

    /// 1 / focal and its sd, 1/px.
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
            // Unknowns of one size each.
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
