//! Estimates the one pose of a stationary car: a robust, information-weighted mean of its detections.

use nalgebra::{Matrix3, Vector3};
use roadplane_base::upper_median;

use crate::{
    descent::MAX_ROUNDS,
    measurement::Observation,
    noise::{Noise, given_heading},
    vehicle::{SCATTER, residual},
};

/// The pose of a car in a stationary interval.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ParkedPose {
    /// Position (m) and heading (rad, modulo π): x, y, heading.
    pub pose: Vector3<f64>,
    /// Covariance that white noise alone gives, m and rad.
    pub white: Matrix3<f64>,
    /// Covariance of the error that all detections share, m and rad.
    pub bias: Matrix3<f64>,
}

/// Estimates the pose of a stationary interval; `None` without detections. Carried-over detections are copies
/// of an earlier detection. They are used only if the interval has no real detection.
pub(crate) fn parked_pose(all: &[Observation]) -> Option<ParkedPose> {
    let measured: Vec<Observation> = all.iter().filter(|o| !o.detection.carried_over).cloned().collect();
    let observations = if measured.is_empty() { all.get(..1)? } else { &measured };
    let inverses: Vec<Matrix3<f64>> =
        observations.iter().map(|o| o.covariance.try_inverse().unwrap_or_else(Matrix3::zeros)).collect();
    let mut pose = start(observations)?;
    let mut information = Matrix3::zeros();
    let off = |pose: &Vector3<f64>| -> (Vec<Vector3<f64>>, Vec<f64>) {
        let square = |(seen, inverse): (&Observation, &Matrix3<f64>)| {
            let d = residual(&seen.pose, pose);
            (d, d.dot(&(inverse * d)))
        };
        observations.iter().zip(&inverses).map(square).unzip()
    };
    for _ in 0..MAX_ROUNDS {
        let (away, squares) = off(&pose);
        let mut sorted = squares.clone();
        let ratio = Noise::measured(&mut sorted, 0.0, 1.0).ratio;
        information = Matrix3::zeros();
        let mut step = Vector3::zeros();
        for ((d, inverse), square) in away.iter().zip(&inverses).zip(&squares) {
            let weight = SCATTER.weight(square / ratio);
            information += inverse * weight;
            step += inverse * d * weight;
        }
        let step = information.cholesky()?.solve(&step);
        pose += step;
        if step.norm() < 1e-12 {
            break;
        }
    }
    let (away, mut squares) = off(&pose);
    let lagged = (1..away.len()).map(|i| away[i - 1].dot(&(inverses[i] * away[i]))).sum();
    let noise = Noise::measured(&mut squares, lagged, 1.0);
    let typical = information.cholesky()?.inverse() * observations.len() as f64;
    let independent = (observations.len() as f64 * noise.ratio / noise.white().max(1e-12)).max(1.0);
    let white = noise.ratio / independent;
    if 2 * observations.iter().filter(|o| o.from_box).count() > observations.len() {
        // A box shows the heading only once, however often it is detected. The drive that led to it may show it better.
        let position_part = given_heading(&typical);
        let white = typical - position_part * (1.0 - white).max(0.0);
        return Some(ParkedPose { pose, white, bias: position_part });
    }
    Some(ParkedPose { pose, white: typical * white, bias: typical * noise.bias(observations) })
}

/// Returns the pose to start from: medians of the position, and the axis on which most detections agree (mean of
/// doubled angles).
fn start(observations: &[Observation]) -> Option<Vector3<f64>> {
    let median = |axis: usize| {
        upper_median(&mut observations.iter().map(|o| o.pose[axis]).collect::<Vec<_>>(), f64::total_cmp)
    };
    let (sin, cos) = observations.iter().fold((0.0, 0.0), |(s, c), o| {
        let weight = 1.0 / o.covariance[(2, 2)];
        let (sin, cos) = (2.0 * o.pose.z).sin_cos();
        (s + weight * sin, c + weight * cos)
    });
    Some(Vector3::new(median(0)?, median(1)?, sin.atan2(cos) / 2.0))
}
