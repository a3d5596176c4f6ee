//! Whether one tracklet continues another, by the data before and after the gap.
//!
//! A pair gains the log likelihood ratio of two hypotheses: "the same vehicle, undetected for a while" against "one
//! vehicle left and another appeared":
//!
//! ```text
//! log Σ_mode P(mode, Δt) p(position, velocity after | before, mode) / (λ + r τ_mode) − log p(velocity)
//!     + terms of class, size and colour
//! ```
//!
//! An undetected vehicle was stationary, drove on, or crept on in a queue. These three modes have the same probability
//! in advance. In each, τ is the mean time for which it stays undetected. Vehicles appear anywhere with the
//! density λ. Where the later tracklet begins, others that drive appear at the rate r. So in flowing traffic, a vehicle
//! is not the stationary one that was there before.

use std::{f64::consts::PI, ops::AddAssign as _};

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use roadplane_base::{fold_axis, upper_median};
use roadplane_measure::HEADING_SD_RAD;

use crate::{
    colour::Colour,
    expected::STATIONARY_S,
    filter::{MOTION_S, SPEED_SD, STATIONARY_MPS, STATIONARY_SHARE, STILL_M, driven, mixed},
    measurement::Observation,
    noise::COMMON_SHARE,
    raw_track::{RawTrack, Votes},
};

/// Mean time for which a driving vehicle stays undetected, s (exponential distribution).
const DRIVES_S: f64 = MOTION_S;
/// Greatest speed of creeping, m/s.
const CREEP_MPS: f64 = 2.5;
/// Density of vehicles that appear anywhere, per m².
const APPEARS: f64 = 2e-5;
/// Sd of the logarithm of a vehicle's size (box diagonal times distance). Views and hidden parts change it.
const SIZE_SD: f64 = 0.3;
/// Votes that each class has in advance, in the order of `VehicleClass::ALL`. Nets confuse cars, trucks and buses with
/// each other, but hardly with motorcycles.
const PRIOR_VOTES: Votes = Votes::new(0.5, 0.5, 0.5, 0.0);

/// The beginning or the end of a tracklet.
pub(crate) struct End {
    /// Time of the beginning or end, s.
    pub time_s: f64,
    /// Position and velocity (x, y, vx, vy) on the ground, m and m/s.
    pub state: Vector4<f64>,
    covariance: Matrix4<f64>,
    /// Heading modulo π, rad.
    axis: f64,
    /// Probability that the vehicle is stationary, 0–1.
    pub stationary_p: f64,
    /// Density of its velocity among stationary vehicles, (m/s)⁻².
    rest_density: f64,
    /// Density of its velocity among driving vehicles, (m/s)⁻².
    drive_density: f64,
    /// Logarithm of the vehicle's size: diagonal of the box (px) times the distance (m).
    log_size: f64,
    /// Mean colour; `None` where none was measured.
    colour: Option<Colour>,
    votes: Votes,
}

impl End {
    /// Computes the beginning of a track, or with `last` its end. `all` are its detections.
    pub fn of(track: &RawTrack, all: &[Observation], last: bool) -> Self {
        let edge = if last { &all[all.len() - 1] } else { &all[0] };
        let near = |o: &&Observation| (o.time_s - edge.time_s).abs() <= MOTION_S;
        let part: Vec<&Observation> = all.iter().filter(near).collect();
        let (state, covariance) = motion(&part, edge.time_s);
        let mut axis = Vector2::zeros();
        for o in &part {
            let weight = 1.0 / (o.covariance[(2, 2)] + HEADING_SD_RAD.powi(2));
            axis += Vector2::new((2.0 * o.pose.z).cos(), (2.0 * o.pose.z).sin()) * weight;
        }
        let velocity = state.fixed_rows::<2>(2).into_owned();
        let spread = covariance.fixed_view::<2, 2>(2, 2).into_owned();
        let [rest_density, drive_density] = [STATIONARY_MPS, SPEED_SD]
            .map(|sd| density(&velocity, &(spread + Matrix2::identity() * sd.powi(2))));
        let log_size = |o: &Observation| {
            let [x0, y0, x1, y1] = o.detection.bbox_px;
            ((x1 - x0).hypot(y1 - y0) * o.pose.xy().norm().max(1.0)).ln()
        };
        let stationary_p = STATIONARY_SHARE * rest_density / mixed(rest_density, drive_density).max(1e-300);
        let mut sizes: Vec<f64> = part.iter().map(|o| log_size(o)).collect();
        Self {
            time_s: edge.time_s,
            state,
            covariance,
            axis: axis.y.atan2(axis.x) / 2.0,
            stationary_p: if edge.detection.carried_over { 1.0 } else { stationary_p },
            rest_density,
            drive_density,
            log_size: upper_median(&mut sizes, f64::total_cmp).unwrap_or_default(),
            colour: Colour::mean(part.iter().copied()),
            votes: track.votes,
        }
    }

    /// Returns the velocity (vx, vy), m/s.
    fn velocity(&self) -> Vector2<f64> {
        self.state.fixed_rows::<2>(2).into_owned()
    }

    /// Returns the covariance of the position, m².
    pub fn place_covariance(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(0, 0).into_owned()
    }
}

/// Estimates position and velocity at a time (s), and their covariance, by a straight line through detections. The
/// noise of a detection is the part of its variance that its neighbours do not share.
fn motion(part: &[&Observation], time_s: f64) -> (Vector4<f64>, Matrix4<f64>) {
    let mut information = Matrix4::zeros();
    information.fixed_view_mut::<2, 2>(2, 2).fill_diagonal((1.5 * SPEED_SD).powi(-2));
    let mut weighted = Vector4::zeros();
    let mut shared = Matrix2::zeros();
    for o in part {
        let covariance = o.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        shared += covariance * (COMMON_SHARE / part.len() as f64);
        let Some(precision) = (covariance * (1.0 - COMMON_SHARE)).try_inverse() else { continue };
        let dt = o.time_s - time_s;
        information += Matrix2::new(1.0, dt, dt, dt * dt).kronecker(&precision);
        weighted += Vector2::new(1.0, dt).kronecker(&(precision * o.pose.xy()));
    }
    let inverse = information.try_inverse().unwrap_or_else(Matrix4::identity);
    let mut covariance = (inverse + inverse.transpose()) / 2.0;
    covariance.fixed_view_mut::<2, 2>(0, 0).add_assign(&shared);
    (inverse * weighted, covariance)
}

/// Returns the density of a 2-D Gaussian with mean 0 at `x`.
pub(crate) fn density(x: &Vector2<f64>, covariance: &Matrix2<f64>) -> f64 {
    let Some(inverse) = covariance.try_inverse() else { return 0.0 };
    (-0.5 * x.dot(&(inverse * x))).exp() / (2.0 * PI * covariance.determinant().max(1e-300).sqrt())
}

/// Returns the log likelihood ratio of one vehicle against two, for a gap in s. Other vehicles appear at the rate
/// `arrivals` where the gap ends, per m² and s.
pub(crate) fn gain(end: &End, start: &End, gap_s: f64, arrivals: f64) -> f64 {
    let moved = start.state.xy() - end.state.xy();
    let places = end.place_covariance() + start.place_covariance();
    // Each mode has its mean time of staying undetected. In this time, the other vehicles appear.
    let mode = |mean_s: f64, density: f64| (-gap_s / mean_s).exp() * density / (APPEARS + arrivals * mean_s);
    let rest_spread = places + Matrix2::identity() * STILL_M.powi(2);
    let rested = mode(STATIONARY_S, end.stationary_p * density(&moved, &rest_spread) * start.rest_density);
    let drove = mode(DRIVES_S, drive_density(end, start, gap_s));
    let crept = mode(STATIONARY_S, creep_density(end, start, &moved, &places, gap_s));
    let same = (rested + drove + crept) / 3.0;
    let new = mixed(start.rest_density, start.drive_density);
    let sizes = -0.5 * ((start.log_size - end.log_size) / SIZE_SD).powi(2);
    let colours = end.colour.zip(start.colour).map_or(0.0, |(before, after)| before.same_vehicle(after));
    (same.max(1e-300) / new.max(1e-300)).ln() + class_gain(end, start) + sizes + colours
}

/// Returns the density of position and velocity after a gap (s) in which the vehicle drove on.
fn drive_density(end: &End, start: &End, gap_s: f64) -> f64 {
    let (state, covariance) = driven(&end.state, &end.covariance, gap_s);
    let away = start.state - state;
    let Some(factor) = (covariance + start.covariance).cholesky() else { return 0.0 };
    let root: f64 = factor.l().diagonal().iter().product();
    (-0.5 * away.dot(&factor.solve(&away))).exp() / ((2.0 * PI).powi(2) * root.max(1e-300))
}

/// Returns the density of position and velocity after a gap (s) of stop and go behind an object. The vehicle covers any
/// distance that creeping allows, along the line of its axis.
fn creep_density(end: &End, start: &End, moved: &Vector2<f64>, places: &Matrix2<f64>, gap_s: f64) -> f64 {
    let slow = (-0.5 * (end.velocity().norm() / CREEP_MPS).powi(2)).exp();
    let axis = end.axis + fold_axis(start.axis - end.axis) / 2.0;
    let (sin, cos) = axis.sin_cos();
    let (ahead, aside) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
    // The axis may point backwards. The motion before and after shows the true direction.
    let sign = (end.velocity() + start.velocity()).dot(&ahead);
    let along = moved.dot(&ahead) * if sign < 0.0 { -1.0 } else { 1.0 };
    let variance_along = |direction: &Vector2<f64>| direction.dot(&(places * direction)).max(0.0);
    let reach = CREEP_MPS * gap_s;
    let beyond = if along < 0.0 { along } else { (along - reach).max(0.0) };
    let outside = (-0.5 * beyond * beyond / (variance_along(&ahead) + STILL_M.powi(2))).exp();
    let off = moved.dot(&aside);
    let variance = variance_along(&aside) + STILL_M.powi(2);
    let on_line = (-0.5 * off * off / variance).exp() / (2.0 * PI * variance).sqrt();
    let speeds = start.covariance.fixed_view::<2, 2>(2, 2) + Matrix2::identity() * (CREEP_MPS / 2.0).powi(2);
    let after = density(&start.velocity(), &speeds);
    slow * outside * on_line / (reach + 1.0) * after
}

/// Returns the log likelihood ratio of the class votes: both tracks are one vehicle, or two unrelated vehicles. It is
/// at most 0, and 0 if one of them has no votes.
fn class_gain(end: &End, start: &End) -> f64 {
    if end.votes.sum() <= 0.0 || start.votes.sum() <= 0.0 {
        return 0.0;
    }
    let shares = |votes: &Votes| (votes + PRIOR_VOTES) / (votes + PRIOR_VOTES).sum();
    let same = shares(&end.votes).dot(&shares(&start.votes));
    same.ln()
}
