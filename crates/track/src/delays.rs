//! The delays of pictures that the steps of moving vehicles show.
//!
//! Within a second, the path of a box's centre is nearly a parabola in time. If a box is
//! ahead of the parabola through its neighbours in time, its picture was taken later, or the box has an error. Errors of
//! boxes differ from vehicle to vehicle, but a delay is common to all of them. So the covariance of two vehicles in the same picture
//! shows the variance of the delays.

use nalgebra::{Matrix3, Vector2, Vector3};
use roadplane_base::{bbox_centre, median};

use crate::{
    filter::MOTION_S,
    noise::{MIN_DETECTIONS, SIGNIFICANT},
    picture_chains::{Chain, size_px},
};

/// Number of boxes before and after a box that show its path, at most and at least. They are within [`MOTION_S`].
const NEIGHBOURS: (usize, usize) = (8, 2);
/// Least step to the farthest neighbour, in box sizes. A slower vehicle shows no delay.
const LEAST_STEP_SIZES: f64 = 0.15;
/// Number of times that the weights are computed.
const ROUNDS: usize = 4;
/// Largest number of steps of the linear solver, and its relative accuracy.
const SOLVER: (usize, f64) = (100, 1e-5);

/// A box compared with its neighbours: `delay − Σ share · delay of the neighbour = lead_s`, with an error.
struct Lead {
    frame: usize,
    /// Time by which the box is ahead of its path, s.
    lead_s: f64,
    /// Sd of `lead_s` if the sd of a box is its size, s. It includes the error of the path.
    sd_per_share_s: f64,
    /// Time to the next picture, about, s.
    interval_s: f64,
    /// Variance of the path's position, in variances of a box.
    path_variance: f64,
    /// Frames of the neighbours, with their shares in the path's position.
    path: Vec<(usize, f64)>,
}

/// The leads of all vehicles in some frames.
pub(crate) struct Delays {
    leads: Vec<Lead>,
    frames: usize,
    /// Sd of a box's centre along its path, as a share of the box's size.
    box_sd: f64,
}

impl Delays {
    /// Compares the boxes of chains with their neighbours. `times_s` are the time stamps of all frames.
    pub(crate) fn of(chains: &[Chain], times_s: &[f64]) -> Self {
        let mut leads: Vec<Lead> = chains.iter().flat_map(|chain| leads_of(chain, times_s)).collect();
        leads.sort_by_key(|lead| lead.frame);
        let mut errors: Vec<f64> = of_frames(&leads).flat_map(errors_of).collect();
        if errors.len() < MIN_DETECTIONS {
            leads.clear();
        }
        // The median of |x| of a normal distribution is 0.6745 sds. Weights of exact boxes must stay finite.
        let box_sd = median(&mut errors).map_or(0.0, |median| median / 0.6745).max(1e-3);
        Self { leads, frames: times_s.len(), box_sd }
    }

    /// Returns the most likely delay of each frame, s, for delays with this sd (s).
    pub(crate) fn estimate(&self, sd_s: f64) -> Vec<f64> {
        let mut delays = vec![0.0; self.frames];
        for round in 0..ROUNDS {
            let weights: Vec<f64> = self
                .leads
                .iter()
                .map(|lead| {
                    let box_sd_s = self.box_sd * lead.sd_per_share_s;
                    // All weights are full at first, as a long delay is no error of the boxes.
                    let off = (lead.lead_s - lead.predicted(&delays)) / (SIGNIFICANT * box_sd_s);
                    1.0 / (box_sd_s.powi(2) * if round == 0 { 1.0 } else { 1.0 + off * off })
                })
                .collect();
            delays = self.solve(delays, &weights, 1.0 / (sd_s * sd_s));
        }
        delays
    }

    /// Solves the weighted least squares with the prior's weight, by conjugate gradients from `x` on.
    fn solve(&self, mut x: Vec<f64>, weights: &[f64], prior: f64) -> Vec<f64> {
        let times_normal = |x: &[f64]| {
            let mut product: Vec<f64> = x.iter().map(|x| prior * x).collect();
            for (lead, weight) in self.leads.iter().zip(weights) {
                lead.add_to(&mut product, weight * lead.predicted(x));
            }
            product
        };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut residual = vec![0.0; self.frames];
        for (lead, weight) in self.leads.iter().zip(weights) {
            lead.add_to(&mut residual, weight * lead.lead_s);
        }
        let goal = SOLVER.1.powi(2) * dot(&residual, &residual);
        residual.iter_mut().zip(times_normal(&x)).for_each(|(left, product)| *left -= product);
        let mut direction = residual.clone();
        let mut left = dot(&residual, &residual);
        for _ in 0..SOLVER.0 {
            if left <= goal {
                break;
            }
            let product = times_normal(&direction);
            let length = left / dot(&direction, &product);
            for i in 0..self.frames {
                x[i] += length * direction[i];
                residual[i] -= length * product[i];
            }
            let next = dot(&residual, &residual);
            for i in 0..self.frames {
                direction[i] = residual[i] + next / left * direction[i];
            }
            left = next;
        }
        x
    }
}

impl Lead {
    /// Returns the time by which these delays would put the box ahead of its path, s.
    fn predicted(&self, delays: &[f64]) -> f64 {
        delays[self.frame] - self.path.iter().map(|(frame, share)| share * delays[*frame]).sum::<f64>()
    }

    /// Adds the transpose of `predicted`, times a factor.
    fn add_to(&self, sums: &mut [f64], factor: f64) {
        sums[self.frame] += factor;
        for (frame, share) in &self.path {
            sums[*frame] -= share * factor;
        }
    }
}

/// Compares each box of a chain with its neighbours.
fn leads_of(chain: &Chain, times_s: &[f64]) -> Vec<Lead> {
    let places: Vec<(usize, Vector2<f64>, f64)> = chain
        .boxes
        .iter()
        .map(|(frame, seen)| (*frame, bbox_centre(&seen.bbox_px), size_px(&seen.bbox_px)))
        .collect();
    (0..places.len()).filter_map(|i| lead(&places, i, times_s)).collect()
}

/// Compares box `i` with the parabola through its neighbours. Places are frame, centre (px) and size (px).
fn lead(places: &[(usize, Vector2<f64>, f64)], i: usize, times_s: &[f64]) -> Option<Lead> {
    let (frame, place, size) = places[i];
    let since = |k: usize| times_s[places[k].0] - times_s[frame];
    let (most, least) = NEIGHBOURS;
    // Time stamps may be equal, or go backwards.
    let is_near = |time_s: f64| 0.0 < time_s && time_s <= MOTION_S;
    let before = (i.saturating_sub(most)..i).filter(|k| is_near(-since(*k)));
    let after = (i + 1..places.len().min(i + 1 + most)).filter(|k| is_near(since(*k)));
    if before.clone().count() < least || after.clone().count() < least {
        return None;
    }
    let near: Vec<usize> = before.chain(after).collect();
    let powers = |k: usize| Vector3::new(1.0, since(k), since(k).powi(2));
    let normal: Matrix3<f64> = near.iter().map(|k| powers(*k) * powers(*k).transpose()).sum();
    let inverse = normal.try_inverse()?;
    let of_path = |row: usize, k: usize| (inverse.row(row) * powers(k))[0];
    let fitted = |row: usize| near.iter().map(|k| places[*k].1 * of_path(row, *k)).sum::<Vector2<f64>>();
    let (expected, velocity) = (fitted(0), fitted(1));
    let speed = velocity.norm();
    let farthest_s = near.iter().map(|k| since(*k).abs()).fold(0.0, f64::max);
    if !speed.is_finite() || speed * farthest_s < LEAST_STEP_SIZES * size {
        return None;
    }
    let path: Vec<(usize, f64)> = near.iter().map(|k| (places[*k].0, of_path(0, *k))).collect();
    let path_variance = path.iter().map(|(_, share)| share * share).sum::<f64>();
    let pictures = places[near[near.len() - 1]].0 - places[near[0]].0;
    Some(Lead {
        frame,
        lead_s: (place - expected).dot(&velocity) / (speed * speed),
        sd_per_share_s: size / speed * (1.0 + path_variance).sqrt(),
        interval_s: (since(near[near.len() - 1]) - since(near[0])) / pictures as f64,
        path_variance,
        path,
    })
}

/// Returns the leads of each frame.
fn of_frames(leads: &[Lead]) -> impl Iterator<Item = &[Lead]> {
    leads.chunk_by(|a, b| a.frame == b.frame)
}

/// Returns the absolute errors of a frame's boxes, relative to each other, as shares of the boxes' sizes.
fn errors_of(leads: &[Lead]) -> Vec<f64> {
    let weight = |lead: &Lead| lead.sd_per_share_s.powi(-2);
    let weights = leads.iter().map(weight).sum::<f64>();
    let mean = leads.iter().map(|lead| weight(lead) * lead.lead_s).sum::<f64>() / weights;
    // The mean takes a share of each error away. A box that has all of the weight shows nothing.
    let left = leads.iter().map(|lead| (lead, 1.0 - weight(lead) / weights)).filter(|(_, left)| *left > 1e-6);
    left.map(|(lead, left)| (lead.lead_s - mean).abs() / (lead.sd_per_share_s * left.sqrt())).collect()
}

/// Evidence on the variance of the delays: sums over frames.
#[derive(Debug, Default)]
pub(crate) struct DelayVariance {
    weights: f64,
    covariance: f64,
    /// Variance of this sum if there are no delays.
    by_chance: f64,
}

impl DelayVariance {
    /// Adds the covariance of each frame's vehicles.
    pub(crate) fn add(&mut self, delays: &Delays) {
        for leads in of_frames(&delays.leads).filter(|leads| leads.len() > 1) {
            let (mut sum, mut sum_of_squares, mut weight, mut weight_of_squares) = (0.0, 0.0, 0.0, 0.0);
            for lead in leads {
                // Delays are seldom longer than two pictures. A tenth of a picture's variance bounds the weight.
                let longest_s = 2.0 * lead.interval_s;
                let lead_s = lead.lead_s.clamp(-longest_s, longest_s) / (1.0 + lead.path_variance).sqrt();
                let variance = (delays.box_sd * lead.sd_per_share_s).powi(2) + 0.1 * lead.interval_s.powi(2);
                sum += lead_s / variance;
                sum_of_squares += (lead_s / variance).powi(2);
                weight += 1.0 / variance;
                weight_of_squares += variance.powi(-2);
            }
            // All pairs of different vehicles. Without delays, the variance of the sum over pairs is twice their
            // weight.
            let pairs = weight * weight - weight_of_squares;
            let share = 1.0 / (leads.len() - 1) as f64;
            self.weights += share * pairs;
            self.covariance += share * (sum * sum - sum_of_squares);
            self.by_chance += share * share * 2.0 * pairs;
        }
    }

    /// Returns the sd of the delays, s; `None` if it may be zero.
    pub(crate) fn sd_s(&self) -> Option<f64> {
        (self.covariance > SIGNIFICANT * self.by_chance.sqrt())
            .then(|| (self.covariance / self.weights).sqrt())
    }
}
