//! Confidence intervals by the cluster bootstrap (Efron & Tibshirani 1993, §8).
//!
//! Whole scenes are resampled, because cars of one scene share a camera and their errors are correlated.

use crate::statistics::sorted_quantile;

/// Number of resamples.
const RESAMPLES: usize = 1000;
/// Seed of the random numbers. It is fixed, so the same data always give the same interval.
const SEED: u64 = 0x5eed;

/// A statistic with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Value of the statistic for the data. It is NaN if there are no data.
    pub value: f64,
    /// 2.5 % quantile of the resampled statistic.
    pub low: f64,
    /// 97.5 % quantile of the resampled statistic.
    pub high: f64,
    /// Number of values. It is not the number of scenes.
    pub n: usize,
}

impl Estimate {
    /// Returns the estimate in another unit: `factor` multiplies the value and the interval.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self { value: self.value * factor, low: self.low * factor, high: self.high * factor, n: self.n }
    }
}

/// Returns a statistic of the values of all scenes, with its 95 % confidence interval.
///
/// Each entry of `scenes` contains the values of one scene. Values may be infinite, for example the error of a missed
/// car.
#[must_use]
pub fn bootstrap(scenes: &[Vec<f64>], statistic: impl Fn(&[f64]) -> f64) -> Estimate {
    let n = scenes.iter().map(Vec::len).sum();
    bootstrap_scenes(scenes, n, |chosen| {
        let values: Vec<f64> = chosen.iter().flat_map(|scene| scene.iter().copied()).collect();
        statistic(&values)
    })
}

/// Returns a statistic of scenes, with its 95 % confidence interval. `n` is the number of values.
///
/// With fewer than two scenes there is no interval: `low` and `high` are NaN.
#[must_use]
pub fn bootstrap_scenes<T>(scenes: &[T], n: usize, statistic: impl Fn(&[&T]) -> f64) -> Estimate {
    let all: Vec<&T> = scenes.iter().collect();
    let value = statistic(&all);
    if scenes.len() < 2 {
        return Estimate { value, low: f64::NAN, high: f64::NAN, n };
    }
    let mut state = SEED;
    let mut resampled: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let chosen: Vec<&T> = all.iter().map(|_| all[below(&mut state, all.len())]).collect();
            statistic(&chosen)
        })
        .filter(|value| !value.is_nan())
        .collect();
    resampled.sort_by(f64::total_cmp);
    Estimate { value, low: sorted_quantile(&resampled, 0.025), high: sorted_quantile(&resampled, 0.975), n }
}

/// Returns a random number from 0 to n − 1 by SplitMix64 (Steele et al. 2014).
///
/// The bias is far below 1e-9, because n is far below 2³².
fn below(state: &mut u64, n: usize) -> usize {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    ((u128::from(z) * n as u128) >> 64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{mean, median};

    #[test]
    fn the_interval_of_a_mean_has_the_width_of_theory() {
        // Each of 400 scenes has one value, alternately 0 and 1. The sd of the mean is 0.5 / √400 = 0.025.
        let scenes: Vec<Vec<f64>> = (0..400).map(|i| vec![f64::from(i % 2)]).collect();
        let estimate = bootstrap(&scenes, mean);
        assert_eq!((estimate.value, estimate.n), (0.5, 400));
        assert!((estimate.high - estimate.low - 2.0 * 1.96 * 0.025).abs() < 0.01, "{estimate:?}");
        assert_eq!(bootstrap(&scenes, mean), estimate);
        // If each scene contains ten copies of its value, there is no more information.
        let copied: Vec<Vec<f64>> = scenes.iter().map(|scene| vec![scene[0]; 10]).collect();
        let same = bootstrap(&copied, mean);
        assert_eq!((same.low, same.high), (estimate.low, estimate.high));
    }

    #[test]
    fn one_scene_has_no_interval() {
        let estimate = bootstrap(&[vec![1.0, 2.0, 3.0]], median);
        assert_eq!(estimate.value, 2.0);
        assert!(estimate.low.is_nan() && estimate.high.is_nan());
    }
}
