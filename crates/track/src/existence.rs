//! The probability that a track is a vehicle.
//!
//! Hedges, road markings, booths and parts of lorries are detected as vehicles again and again. The evidence on a
//! track together decides whether it is one: a logistic model of the track's [`Evidence`].
//!
//! `scripts/train/tracks` fits the model by maximum likelihood. `models/tracks.json` has the weights, and
//! `models/tracks.md` the data, the method and the reliability.

use std::f64::consts::TAU;

use nalgebra::{SVector, Vector2};
use roadplane_base::{VehicleClass, bbox_iou};

use crate::{
    TrackState,
    filter::{MOTION_S, SPEED_SD, STATIONARY_MPS, mixed},
    measurement::Observation,
    numbers::{FEATURES, NUMBERS, sigmoid},
};

/// Scale of a displacement, m. Far away, positions of stationary objects jitter by about as much.
const MOVED_M: f64 = 3.0;
/// Mean and sd of the speed of people who walk, m/s (Weidmann 1993, "Transporttechnik der Fussgänger").
const WALKING_MPS: (f64, f64) = (1.34, 0.26);

/// The evidence on a track that shows whether it is a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Class of the track.
    pub class: VehicleClass,
    /// Mean log odds of the detector's scores.
    pub score: f64,
    /// Distance that it moves while it is observed, in units of 3 m, times the share of its box that it leaves.
    pub moved: f64,
    /// Share of its detections for which a car's keypoints were fitted, 0–1.
    pub fitted: f64,
    /// Mean logarithm of the distances (rms) of their keypoints from the projections, relative to the usual one.
    pub log_rms: f64,
    /// Height above that of the site's mean car, m.
    pub above_car_m: f64,
    /// Probability that a motorcycle is a vehicle and not a walking person, 0–1; 1 for other classes.
    pub rides_p: f64,
}

impl Evidence {
    /// Collects the evidence of a track. `states` are its smoothed states, one per frame from the first detection on;
    /// they may be empty. `above_car_m` is its height above that of the site's mean car. `None` without a detection.
    pub(crate) fn of(
        observations: &[Observation],
        states: &[TrackState],
        class: VehicleClass,
        above_car_m: f64,
    ) -> Option<Self> {
        observations.first()?;
        // Carried-over detections are copies.
        let measured: Vec<&Observation> = observations.iter().filter(|o| !o.detection.carried_over).collect();
        let measured = if measured.is_empty() { observations.iter().collect() } else { measured };
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        let odds: Vec<f64> = measured.iter().map(|o| log_odds(o.detection.score)).collect();
        let log_rms: Vec<f64> = measured.iter().filter_map(|o| Some(o.misfit()?.ln())).collect();
        // Nets take walking people for motorcycles, but their speed differs.
        let fastest = (states.iter().filter(|_| class == VehicleClass::Motorcycle))
            .max_by(|a, b| a.speed_mps.abs().total_cmp(&b.speed_mps.abs()));
        Some(Self {
            class,
            score: mean(&odds),
            moved: moved(observations, states),
            fitted: log_rms.len() as f64 / measured.len() as f64,
            log_rms: mean(&log_rms),
            above_car_m,
            rides_p: fastest.map_or(1.0, |state| rides_p(state.speed_mps.abs(), state.speed_sd_mps)),
        })
    }

    /// Returns the features of the model.
    #[must_use]
    pub fn features(&self) -> [f64; FEATURES] {
        let is = |yes: bool| f64::from(u8::from(yes));
        let is_car = is(self.class == VehicleClass::Car);
        [
            1.0,
            self.score,
            self.moved.ln_1p(),
            is_car * (1.0 - self.fitted),
            is_car * self.fitted * self.log_rms,
            is_car * self.above_car_m.min(0.0),
            1.0 - is_car,
        ]
    }

    /// Returns the log odds that the track is a vehicle.
    pub(crate) fn log_odds(&self) -> f64 {
        SVector::from(self.features()).dot(&NUMBERS.existence)
    }

    /// Returns the probability that the track is a vehicle, 0–1.
    #[must_use]
    pub fn probability(&self) -> f64 {
        self.rides_p * sigmoid(self.log_odds())
    }
}

/// Returns the probability that an object with this highest speed and its sd (m/s) is a vehicle and not a walking
/// person. In advance, both are equally probable.
fn rides_p(speed_mps: f64, sd_mps: f64) -> f64 {
    // The density of a vehicle's speed, if both components of its velocity have this sd (Rayleigh distribution).
    let vehicle = |sd: f64| {
        let variance = sd.powi(2) + sd_mps.powi(2);
        speed_mps / variance * (-0.5 * speed_mps.powi(2) / variance).exp()
    };
    // At impossible speeds, both densities vanish.
    let vehicle = mixed(vehicle(STATIONARY_MPS), vehicle(SPEED_SD)).max(f64::MIN_POSITIVE);
    let (mean, sd) = (WALKING_MPS.0, WALKING_MPS.1.hypot(sd_mps));
    let walking = (-0.5 * ((speed_mps - mean) / sd).powi(2)).exp() / (TAU.sqrt() * sd);
    if speed_mps > 0.0 { vehicle / (vehicle + walking) } else { 1.0 }
}

/// Returns the log odds of a score, 0–1.
fn log_odds(score: f64) -> f64 {
    let score = score.clamp(0.02, 0.98);
    (score / (1.0 - score)).ln()
}

/// Returns how far a track moves within a time in which it is observed. Clutter never leaves its box.
fn moved(observations: &[Observation], states: &[TrackState]) -> f64 {
    let near = |a: &Observation, b: &Observation| b.time_s - a.time_s <= MOTION_S;
    let at = |seen: &Observation| {
        let state = states.get(seen.frame - observations[0].frame);
        state.map_or(seen.pose.xy(), |state| Vector2::new(state.pose.x_m, state.pose.y_m))
    };
    let of_part = |part: &[Observation]| {
        let (from, to) = part.first().zip(part.last())?;
        let moved = at(to) - at(from);
        Some(moved.norm() / MOVED_M * (1.0 - bbox_iou(&from.detection.bbox_px, &to.detection.bbox_px)))
    };
    observations.chunk_by(near).filter_map(of_part).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stationary car with middling scores, whose keypoints fit.
    const CAR: Evidence = Evidence {
        class: VehicleClass::Car,
        score: 0.5,
        moved: 0.0,
        fitted: 1.0,
        log_rms: 0.0,
        above_car_m: 0.0,
        rides_p: 1.0,
    };

    #[test]
    fn each_kind_of_evidence_changes_the_probability_in_its_direction() {
        let p = |evidence: Evidence| evidence.probability();
        assert!(p(CAR) > 0.9, "{}", p(CAR));
        let more = [Evidence { score: 1.0, ..CAR }, Evidence { moved: 5.0, ..CAR }];
        assert!(more.into_iter().all(|evidence| p(evidence) > p(CAR)));
        let less = [
            Evidence { score: -0.5, ..CAR },
            Evidence { fitted: 0.0, ..CAR },
            Evidence { log_rms: 1.2, ..CAR },
            Evidence { above_car_m: -0.4, ..CAR },
        ];
        assert!(less.into_iter().all(|evidence| p(evidence) < p(CAR)));
        // A hedge: middling scores, keypoints that do not fit, and a low body.
        assert!(p(Evidence { score: 0.0, log_rms: 1.2, above_car_m: -0.35, ..CAR }) < 0.5);
        // The shape of other vehicles is no evidence.
        let bus = Evidence { class: VehicleClass::Bus, fitted: 0.0, ..CAR };
        assert_eq!(bus.features(), Evidence { fitted: 1.0, above_car_m: -0.7, ..bus }.features());
    }

    #[test]
    fn people_walk_and_motorcycles_rest_or_ride() {
        // Stationary, and as fast as vehicles whose speed is measured well or badly.
        for (speed_mps, sd_mps) in
            [(0.0, 0.1), (0.1, 0.1), (0.3, 0.3), (4.3, 0.5), (5.0, 1.2), (30.0, 5.0), (900.0, 0.1)]
        {
            assert!(rides_p(speed_mps, sd_mps) > 0.8, "{speed_mps} ± {sd_mps}");
        }
        for (speed_mps, sd_mps) in [(1.0, 0.1), (1.5, 0.5), (1.6, 0.3), (2.2, 0.5)] {
            assert!(rides_p(speed_mps, sd_mps) < 0.2, "{speed_mps} ± {sd_mps}");
        }
    }

    #[test]
    fn a_score_without_doubt_has_finite_odds() {
        assert!([0.0, 1.0].into_iter().all(|score| log_odds(score).is_finite()));
        assert!(log_odds(0.5).abs() < 1e-12);
    }
}
