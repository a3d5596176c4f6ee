//! The offsets of lanes from a reference line: a mixture over vehicles, whose number of lanes follows from the data.
//!
//! The offset of vehicle i in window w is normal around `mean[k] + shift[w]`, if the vehicle is in lane k there. Its
//! variance is that of the lane plus that of the vehicle's position. Between windows, a vehicle stays in its lane or
//! leaves it with a small probability: a hidden Markov model, solved by expectation maximisation (Rabiner 1989, §III).
//! A further state with a uniform density holds vehicles between lanes. The number of lanes has the least Bayesian
//! information criterion (Schwarz 1978). A vehicle counts as one observation there, because its errors in all windows
//! are correlated.

/// Least distance between the middles of two lanes, m. The narrowest lanes of the AASHTO Green Book (2018, §4.3) have
/// 2.7 m; the metric scale has an error of a few percent.
const LEAST_APART_M: f64 = 2.5;
/// Bounds of the sd of vehicles around the middle of their lane, m.
const WANDER_M: [f64; 2] = [0.15, 0.8];
/// Sd of a lane's middle in one window around its mean, m.
const LOCAL_SD_M: f64 = 0.3;
/// Sd of a lane's middle in a window with almost no vehicles, m.
const MOST_SD_M: f64 = 1.0;
/// Probability that a vehicle leaves its lane within a window.
const LEAVES_P: f64 = 0.05;
/// Number of windows before and after a change of lanes in which a vehicle is not in the middle of its lane: 18 m. A
/// change takes 22 to 40 m in rendered streets.
const SETTLED: usize = 3;
const MOST_LANES: usize = 8;
const ITERATIONS: usize = 20;

/// The mean offset of a vehicle in a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Index of the window.
    pub window: usize,
    /// Offset to the left of the reference line, m.
    pub left_m: f64,
    /// Variance of the offset, m².
    pub variance: f64,
}

/// Lanes along a reference line.
#[derive(Clone, Debug)]
pub(super) struct Lanes {
    /// Mean offset of each lane, m, from right to left.
    means_m: Vec<f64>,
    /// Shift of all lanes in each window, m.
    shifts_m: Vec<f64>,
    /// Sd of vehicles around the middle of their lane, m.
    pub wander_m: f64,
    /// Density of the offset of a vehicle between lanes, 1/m.
    between: f64,
}

impl Lanes {
    /// Returns the lanes of vehicles. Each vehicle has its samples in the order of windows.
    pub(super) fn fit(vehicles: &[Vec<Sample>], windows: usize) -> Option<Self> {
        let mut offsets: Vec<f64> = vehicles.iter().flatten().map(|sample| sample.left_m).collect();
        offsets.sort_unstable_by(f64::total_cmp);
        let range = offsets.last()? - offsets.first()?;
        let mut best: Option<(f64, Self)> = None;
        for lanes in 1..=MOST_LANES.min(1 + (range / LEAST_APART_M) as usize) {
            let Some(means_m) = spread_means(&offsets, lanes) else { continue };
            let start = Self {
                means_m,
                shifts_m: vec![0.0; windows],
                wander_m: 0.4,
                between: 1.0 / (range + 2.0 * LEAST_APART_M),
            };
            let Some((fitted, log_likelihood)) = start.maximised(vehicles) else { continue };
            let count = vehicles.iter().filter(|samples| !samples.is_empty()).count() as f64;
            let criterion = 2.0 * lanes as f64 * count.ln() - 2.0 * log_likelihood;
            if best.as_ref().is_none_or(|best| criterion < best.0) {
                best = Some((criterion, fitted));
            }
        }
        best.map(|best| best.1)
    }

    /// Returns the number of lanes.
    pub(super) fn count(&self) -> usize {
        self.means_m.len()
    }

    /// Runs the expectation maximisation. Returns `None` if a lane is empty. The log likelihood counts each
    /// vehicle as one observation.
    fn maximised(mut self, vehicles: &[Vec<Sample>]) -> Option<(Self, f64)> {
        let mut log_likelihood = 0.0;
        for _ in 0..ITERATIONS {
            log_likelihood = 0.0;
            let mut posteriors = Vec::with_capacity(vehicles.len());
            for samples in vehicles {
                let (posterior, log) = self.posterior(samples);
                log_likelihood += log / samples.len().max(1) as f64;
                posteriors.push(posterior);
            }
            let weighted = || {
                vehicles
                    .iter()
                    .zip(&posteriors)
                    .flat_map(|(samples, posterior)| samples.iter().zip(posterior))
                    .flat_map(|(sample, posterior)| {
                        (0..self.count()).map(move |lane| (sample, lane, posterior[lane]))
                    })
            };
            let wander = self.wander_m.powi(2);
            let mut sums = vec![[0.0; 2]; self.count()];
            let mut shifts = vec![[0.0, LOCAL_SD_M.powi(-2)]; self.shifts_m.len()];
            let mut spread = [0.0, 0.0];
            for (sample, lane, p) in weighted() {
                let weight = p / (wander + sample.variance);
                let left_m = sample.left_m - self.shifts_m[sample.window];
                sums[lane][0] += weight * left_m;
                sums[lane][1] += weight;
                let residual = left_m - self.means_m[lane];
                shifts[sample.window][0] += weight * (sample.left_m - self.means_m[lane]);
                shifts[sample.window][1] += weight;
                spread[0] += p * (residual.powi(2) - sample.variance);
                spread[1] += p;
            }
            if sums.iter().any(|sum| sum[1] <= 0.0) {
                return None;
            }
            self.means_m = sums.iter().map(|sum| sum[0] / sum[1]).collect();
            self.shifts_m = shifts.iter().map(|shift| shift[0] / shift[1]).collect();
            self.wander_m = (spread[0] / spread[1]).max(0.0).sqrt().clamp(WANDER_M[0], WANDER_M[1]);
            let weights: Vec<f64> = sums.iter().map(|sum| sum[1]).collect();
            keep_apart(&mut self.means_m, &weights);
        }
        Some((self, log_likelihood))
    }

    /// Returns, for each sample, the probability of each lane and of the state between lanes; and the log likelihood.
    pub(super) fn posterior(&self, samples: &[Sample]) -> (Vec<Vec<f64>>, f64) {
        let states = self.count() + 1;
        let emission = |sample: &Sample, state: usize| {
            if state == self.count() {
                return self.between;
            }
            let variance = self.wander_m.powi(2) + sample.variance;
            let residual = sample.left_m - self.means_m[state] - self.shifts_m[sample.window];
            // The least density keeps numbers finite.
            ((-residual.powi(2) / (2.0 * variance)).exp() / (std::f64::consts::TAU * variance).sqrt())
                .max(1e-12)
        };
        let moves = LEAVES_P / (states - 1) as f64;
        let mixed = |from: &[f64], state: usize| {
            let all: f64 = from.iter().sum();
            from[state] * (1.0 - LEAVES_P) + (all - from[state]) * moves
        };
        let mut log_likelihood = 0.0;
        let mut forward: Vec<Vec<f64>> = Vec::with_capacity(samples.len());
        for sample in samples {
            let mut now: Vec<f64> = (0..states)
                .map(|state| {
                    let before = match forward.last() {
                        Some(last) => mixed(last, state),
                        None if state == self.count() => LEAVES_P,
                        None => (1.0 - LEAVES_P) / self.count() as f64,
                    };
                    before * emission(sample, state)
                })
                .collect();
            let sum: f64 = now.iter().sum();
            now.iter_mut().for_each(|p| *p /= sum);
            log_likelihood += sum.ln();
            forward.push(now);
        }
        let mut backward = vec![1.0; states];
        for (i, sample) in samples.iter().enumerate().rev() {
            let mut sum = 0.0;
            for (p, b) in forward[i].iter_mut().zip(&backward) {
                *p *= b;
                sum += *p;
            }
            forward[i].iter_mut().for_each(|p| *p /= sum);
            let ahead: Vec<f64> =
                (0..states).map(|state| backward[state] * emission(sample, state)).collect();
            let total: f64 = ahead.iter().sum();
            backward = (0..states).map(|state| mixed(&ahead, state) / total).collect();
        }
        (forward, log_likelihood)
    }

    /// Returns the offset of a lane in each window and its sd, m, and the number of vehicles in it there.
    ///
    /// A vehicle that is about to change lanes does not count. The sd is the larger of two: that of the model, and that
    /// from the scatter of the vehicles (White 1980).
    pub(super) fn offsets(&self, lane: usize, vehicles: &[Vec<Sample>]) -> Vec<(f64, f64, f64)> {
        let mut entries: Vec<Vec<(f64, f64)>> = vec![Vec::new(); self.shifts_m.len()]; // weight, offset
        let mut counts = vec![0.0; self.shifts_m.len()];
        for samples in vehicles {
            let (posterior, _) = self.posterior(samples);
            for (i, sample) in samples.iter().enumerate() {
                let near = &posterior[i.saturating_sub(SETTLED)..(i + SETTLED + 1).min(samples.len())];
                let p = near.iter().map(|p| p[lane]).fold(1.0, f64::min);
                entries[sample.window].push((p / (self.wander_m.powi(2) + sample.variance), sample.left_m));
                counts[sample.window] += posterior[i][lane];
            }
        }
        let prior = LOCAL_SD_M.powi(-2);
        let offset = |(window, entries): (usize, &Vec<(f64, f64)>)| {
            let expected = self.means_m[lane] + self.shifts_m[window];
            if entries.is_empty() {
                return (expected, MOST_SD_M, 0.0);
            }
            let sum = |of: &dyn Fn(&(f64, f64)) -> f64| entries.iter().map(of).sum::<f64>();
            let (total, squares) = (sum(&|e| e.0), sum(&|e| e.0.powi(2)));
            let mean = (sum(&|e| e.0 * e.1) + prior * expected) / (total + prior);
            // The prior is left out of the sd, because it is estimated from the same vehicles.
            let freedom = (1.0 - squares / total.powi(2)).max(0.1);
            let scatter = (sum(&|e| (e.0 * (e.1 - mean)).powi(2)) / freedom).sqrt() / total;
            (mean, scatter.max(total.sqrt().recip()).min(MOST_SD_M), counts[window])
        };
        entries.iter().enumerate().map(offset).collect()
    }
}

/// Moves lanes apart that are too close, each by the other's share of the weight.
fn keep_apart(means_m: &mut [f64], weights: &[f64]) {
    for _ in 0..means_m.len() {
        for i in 1..means_m.len() {
            let lacking_m = LEAST_APART_M - (means_m[i] - means_m[i - 1]);
            if lacking_m > 0.0 {
                let share = weights[i] / (weights[i] + weights[i - 1]);
                means_m[i - 1] -= lacking_m * share;
                means_m[i] += lacking_m * (1.0 - share);
            }
        }
    }
}

/// Returns the means of the best division of sorted numbers into groups: the least sum of squares, by dynamic
/// programming (Wang and Song 2011), over at most 400 numbers. `None` if there are fewer numbers than groups.
fn spread_means(sorted: &[f64], groups: usize) -> Option<Vec<f64>> {
    let every = sorted.len().div_ceil(400).max(1);
    let values: Vec<f64> = sorted.iter().step_by(every).copied().collect();
    let n = values.len();
    if n < groups {
        return None;
    }
    let sums: Vec<[f64; 2]> = std::iter::once([0.0; 2])
        .chain(values.iter().scan([0.0; 2], |sum, value| {
            *sum = [sum[0] + value, sum[1] + value * value];
            Some(*sum)
        }))
        .collect();
    let squares = |from: usize, to: usize| {
        let sum = sums[to][0] - sums[from][0];
        sums[to][1] - sums[from][1] - sum * sum / (to - from) as f64
    };
    let mut cost: Vec<f64> = (0..=n).map(|to| if to == 0 { 0.0 } else { squares(0, to) }).collect();
    let mut starts = vec![vec![0; n + 1]];
    for group in 1..groups {
        let mut next = vec![f64::INFINITY; n + 1];
        let mut start = vec![0; n + 1];
        for to in group + 1..=n {
            let sums = cost
                .iter()
                .enumerate()
                .take(to)
                .skip(group)
                .map(|(from, cost)| (cost + squares(from, to), from));
            if let Some(best) = sums.min_by(|a, b| a.0.total_cmp(&b.0)) {
                (next[to], start[to]) = best;
            }
        }
        cost = next;
        starts.push(start);
    }
    let mut means = Vec::new();
    let mut to = n;
    for start in starts.iter().rev() {
        let from = start[to];
        means.push((sums[to][0] - sums[from][0]) / (to - from) as f64);
        to = from;
    }
    means.reverse();
    Some(means)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_without_vehicles_has_the_largest_sd() {
        let samples = |left_m: f64| [0, 2].map(|window| Sample { window, left_m, variance: 0.01 }).to_vec();
        let vehicles: Vec<_> = [-0.2, 0.0, 0.2].map(samples).to_vec();
        let offsets = Lanes::fit(&vehicles, 3).unwrap().offsets(0, &vehicles);
        assert!(offsets.iter().all(|offset| offset.0.abs() < 0.05), "{offsets:?}");
        assert!(offsets[1].1 >= MOST_SD_M && offsets[1].2 <= 0.0, "{offsets:?}");
        assert!([0, 2].iter().all(|&window| (0.05..0.5).contains(&offsets[window].1)), "{offsets:?}");
    }
}
