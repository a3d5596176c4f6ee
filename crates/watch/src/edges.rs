//! Measures straight edges to a fraction of a pixel.

use nalgebra::{Matrix2, Vector2};
use opencv::core::{Mat, MatTraitConst as _, MatTraitConstManual as _};
use roadplane_base::{SceneLine, median};

use crate::WatchError;

/// Distance to each side of an edge up to which the change of the grey value is measured, px.
const REACH_PX: f64 = 2.5;
/// Distance between the points across an edge at which the change is measured, px.
const STEP_PX: f64 = 0.5;
/// Standard deviation of the Gaussian weight across an edge, px. The weight suppresses other edges beside it.
const NEAR_PX: f64 = 1.2;
/// Smallest change at a sample of an edge, as a share of the median over its samples. Samples with a smaller change are
/// dropped.
const LEAST_CHANGE: f64 = 0.25;
/// Smallest number of samples to which a line is fitted.
const MIN_SAMPLES: usize = 6;
/// Number of neighbouring samples (one per pixel) that have the same error. Lens, sensor and compression spread an
/// error over this width.
const SHARED_SAMPLES: f64 = 4.0;
/// Additional error of an edge's position that the scatter of its samples does not show, px (sd). It is due to the size
/// of pixels and to uneven walls.
const FLOOR_PX: f64 = 0.08;

/// A sample on an edge: its distance along the edge, its offset across the edge, the strength of change, and its
/// weight.
struct Sample {
    along: f64,
    off: f64,
    change: f64,
    weight: f64,
}

/// A grey picture in which edges are measured.
pub(crate) struct Edges {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl Edges {
    /// Copies a smoothed grey picture.
    pub(crate) fn of(grey: &Mat) -> Result<Self, WatchError> {
        let count = |length: i32| usize::try_from(length).unwrap_or(0);
        Ok(Self {
            width: count(grey.cols()),
            height: count(grey.rows()),
            values: grey.data_bytes()?.to_vec(),
        })
    }

    /// Returns the grey value at a point by bilinear interpolation. A point outside the picture gets the value at the
    /// border.
    fn at(&self, point: &Vector2<f64>) -> f64 {
        let clamped = |v: f64, count: usize| v.clamp(0.0, (count.max(2) - 1) as f64 - 1e-6);
        let (x, y) = (clamped(point.x, self.width), clamped(point.y, self.height));
        let (column, row) = (x as usize, y as usize);
        let (right, low) = (x - column as f64, y - row as f64);
        let value = |dx: usize, dy: usize| {
            let at = (row + dy).min(self.height - 1) * self.width + (column + dx).min(self.width - 1);
            f64::from(self.values[at])
        };
        let upper = value(0, 0) * (1.0 - right) + value(1, 0) * right;
        let lower = value(0, 1) * (1.0 - right) + value(1, 1) * right;
        upper * (1.0 - low) + lower * low
    }

    /// Fits a line near a segment to the points of steepest change, by reweighted least squares.
    ///
    /// The result begins at its upper end. Returns `None` if too few samples show an edge.
    pub(crate) fn refitted(&self, ends: &[Vector2<f64>; 2]) -> Option<SceneLine> {
        let length = (ends[1] - ends[0]).norm();
        let along = (ends[1] - ends[0]).try_normalize(1e-9)?;
        let across = Vector2::new(-along.y, along.x);
        let mut samples = self.samples(&ends[0], &along, length);
        let median_change = median(&mut samples.iter().map(|p| p.change).collect::<Vec<_>>())?;
        samples.retain(|sample| sample.change > LEAST_CHANGE * median_change);
        if samples.len() < MIN_SAMPLES {
            return None;
        }
        let mut line = Vector2::zeros();
        for _ in 0..5 {
            let (mut normal, mut sum) = (Matrix2::zeros(), Vector2::zeros());
            for sample in &samples {
                let row = Vector2::new(1.0, sample.along - 0.5 * length);
                normal += sample.weight * row * row.transpose();
                sum += sample.weight * sample.off * row;
            }
            line = normal.cholesky()?.solve(&sum);
            let residual = |p: &Sample| p.off - line.x - line.y * (p.along - 0.5 * length);
            let scatter = median(&mut samples.iter().map(|p| residual(p).abs()).collect::<Vec<_>>())?;
            let bound = 2.0 * (1.4826 * scatter).max(0.05);
            for sample in &mut samples {
                sample.weight = 1.0 / (1.0 + (residual(sample) / bound).powi(2));
            }
        }
        let residual = |p: &Sample| p.off - line.x - line.y * (p.along - 0.5 * length);
        let weights: f64 = samples.iter().map(|p| p.weight).sum();
        let scatter = (samples.iter().map(|p| p.weight * residual(p).powi(2)).sum::<f64>() / weights).sqrt();
        let independent = (samples.len() as f64 / SHARED_SAMPLES).max(1.0);
        let sd_rad = 12f64.sqrt() * (scatter / independent.sqrt()).hypot(FLOOR_PX) / length;
        let end = |at: f64| ends[0] + at * along + (line.x + line.y * (at - 0.5 * length)) * across;
        let (a, b) = (end(0.0), end(length));
        Some(SceneLine { ends_px: if a.y <= b.y { [a, b] } else { [b, a] }, sd_rad })
    }

    /// Locates the steepest change across a segment at every pixel along it. Only changes with the sign of the edge as
    /// a whole count (dark to light, or light to dark).
    fn samples(&self, from: &Vector2<f64>, along: &Vector2<f64>, length: f64) -> Vec<Sample> {
        let across = Vector2::new(-along.y, along.x);
        let steps = (REACH_PX / STEP_PX) as i32;
        let change = |at: f64, off: f64| {
            let here = from + at * along + off * across;
            self.at(&(here + STEP_PX * across)) - self.at(&(here - STEP_PX * across))
        };
        let offs: Vec<f64> = (-steps..=steps).map(|step| f64::from(step) * STEP_PX).collect();
        let stations: Vec<f64> = (0..length as usize).map(|i| i as f64 + 0.5).collect();
        let changes: Vec<Vec<f64>> =
            stations.iter().map(|at| offs.iter().map(|off| change(*at, *off)).collect()).collect();
        let sign = changes.iter().flatten().sum::<f64>().signum();
        let sample = |(at, changes): (&f64, &Vec<f64>)| {
            let weights = offs
                .iter()
                .zip(changes)
                .map(|(off, change)| (sign * change).max(0.0) * (-0.5 * (off / NEAR_PX).powi(2)).exp());
            let weights: Vec<f64> = weights.collect();
            let total: f64 = weights.iter().sum();
            let off = weights.iter().zip(&offs).map(|(w, off)| w * off).sum::<f64>() / total.max(1e-9);
            Sample { along: *at, off, change: total, weight: 1.0 }
        };
        stations.iter().zip(&changes).map(sample).collect()
    }
}
