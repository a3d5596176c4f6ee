//! Edges to a fraction of a pixel.

use nalgebra::{Matrix2, Vector2};
use opencv::core::{Mat, MatTraitConst as _, MatTraitConstManual as _};
use roadplane_base::{SceneLine, median};

use crate::WatchError;

/// Change is looked at so far to either side, px, …
const REACH_PX: f64 = 2.5;
/// … in steps of this.
const STEP_PX: f64 = 0.5;
/// What lies further from the line counts less, px (sd): other edges run beside it.
const NEAR_PX: f64 = 1.2;
/// Places with less than this share of the edge's median change say nothing.
const LEAST_CHANGE: f64 = 0.25;
/// Fewest places that make a line.
const LEAST_PLACES: usize = 6;
/// So many neighbouring places, a pixel apart, share their error: the width of lens, sensor and compression.
const SHARED_PLACES: f64 = 4.0;
/// What an edge's course is off by beside its scatter, px: pixels are squares, walls have plaster.
const FLOOR_PX: f64 = 0.08;

/// A place on an edge: how far along it, how far off, and its weight.
struct Place {
    along: f64,
    off: f64,
    change: f64,
    weight: f64,
}

/// A grey picture in which edges are laid.
pub(crate) struct Edges {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl Edges {
    /// Of a smoothed grey picture.
    pub(crate) fn of(grey: &Mat) -> Result<Self, WatchError> {
        let count = |length: i32| usize::try_from(length).unwrap_or(0);
        Ok(Self {
            width: count(grey.cols()),
            height: count(grey.rows()),
            values: grey.data_bytes()?.to_vec(),
        })
    }

    /// Grey value between pixels, bilinear; beyond the rim that of the rim.
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

    /// The line through the places of steepest change near a segment, by reweighted least squares, upper end first. `None` where
    /// too few places show an edge.
    pub(crate) fn laid_anew(&self, ends: &[Vector2<f64>; 2]) -> Option<SceneLine> {
        let length = (ends[1] - ends[0]).norm();
        let along = (ends[1] - ends[0]).try_normalize(1e-9)?;
        let across = Vector2::new(-along.y, along.x);
        let mut places = self.places(&ends[0], &along, length);
        let median_change = median(&mut places.iter().map(|p| p.change).collect::<Vec<_>>())?;
        places.retain(|place| place.change > LEAST_CHANGE * median_change);
        if places.len() < LEAST_PLACES {
            return None;
        }
        let mut line = Vector2::zeros();
        for _ in 0..5 {
            let (mut normal, mut sum) = (Matrix2::zeros(), Vector2::zeros());
            for place in &places {
                let row = Vector2::new(1.0, place.along - 0.5 * length);
                normal += place.weight * row * row.transpose();
                sum += place.weight * place.off * row;
            }
            line = normal.cholesky()?.solve(&sum);
            let residual = |p: &Place| p.off - line.x - line.y * (p.along - 0.5 * length);
            let scatter = median(&mut places.iter().map(|p| residual(p).abs()).collect::<Vec<_>>())?;
            let bound = 2.0 * (1.4826 * scatter).max(0.05);
            for place in &mut places {
                place.weight = 1.0 / (1.0 + (residual(place) / bound).powi(2));
            }
        }
        let residual = |p: &Place| p.off - line.x - line.y * (p.along - 0.5 * length);
        let weights: f64 = places.iter().map(|p| p.weight).sum();
        let scatter = (places.iter().map(|p| p.weight * residual(p).powi(2)).sum::<f64>() / weights).sqrt();
        let independent = (places.len() as f64 / SHARED_PLACES).max(1.0);
        let sd_rad = 12f64.sqrt() * (scatter / independent.sqrt()).hypot(FLOOR_PX) / length;
        let end = |at: f64| ends[0] + at * along + (line.x + line.y * (at - 0.5 * length)) * across;
        let (a, b) = (end(0.0), end(length));
        Some(SceneLine { ends_px: if a.y <= b.y { [a, b] } else { [b, a] }, sd_rad })
    }

    /// Where the picture changes most across a segment, every pixel along it; only change of the segment's own sign counts.
    fn places(&self, from: &Vector2<f64>, along: &Vector2<f64>, length: f64) -> Vec<Place> {
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
        let place = |(at, changes): (&f64, &Vec<f64>)| {
            let weights = offs
                .iter()
                .zip(changes)
                .map(|(off, change)| (sign * change).max(0.0) * (-0.5 * (off / NEAR_PX).powi(2)).exp());
            let weights: Vec<f64> = weights.collect();
            let total: f64 = weights.iter().sum();
            let off = weights.iter().zip(&offs).map(|(w, off)| w * off).sum::<f64>() / total.max(1e-9);
            Place { along: *at, off, change: total, weight: 1.0 }
        };
        stations.iter().zip(&changes).map(place).collect()
    }
}
