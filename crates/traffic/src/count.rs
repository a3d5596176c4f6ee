//! The number of vehicles that cross a gate, with its interval.
//!
//! Each crossing has a probability, so the number of crossings has a Poisson-binomial distribution. Two more errors widen
//! it. The gate may lie elsewhere relative to all vehicles, if it is given in metres or on the map. And vehicles that
//! have no track are not counted.

use crate::Crossing;

/// Returns the interval of 95 % of a number of vehicles, as the lowest and the highest number.
///
/// `crossings` are pairs of a crossing and the probability that its vehicle exists. `shared_sd_m` is the sd of the gate's
/// place relative to all vehicles. `missed_share` is the expected share of vehicles without a track.
#[must_use]
pub fn count_interval(crossings: &[(&Crossing, f64)], shared_sd_m: f64, missed_share: f64) -> [u64; 2] {
    let nodes = if shared_sd_m > 0.0 { NODES.as_slice() } else { &NODES[..1] };
    let weight_of = |a: f64, b: f64| if nodes.len() == 1 { 1.0 } else { a * b };
    let mut sum: Vec<f64> = Vec::new();
    for &(ahead, a) in nodes {
        for &(along, b) in nodes {
            let probability = |(crossing, exists_p): &(&Crossing, f64)| {
                exists_p * crossing.probability(ahead * shared_sd_m, along * shared_sd_m)
            };
            let counted = poisson_binomial(crossings.iter().map(probability));
            add(&mut sum, &counted, weight_of(a, b));
        }
    }
    interval(&with_missed(&sum, missed_share))
}

/// Places and weights of the Gauss–Hermite quadrature with three nodes for a standard normal number.
const NODES: [(f64, f64); 3] =
    [(0.0, 2.0 / 3.0), (1.732_050_807_568_877_2, 1.0 / 6.0), (-1.732_050_807_568_877_2, 1.0 / 6.0)];
/// Probabilities nearer to 0 or 1 than this are taken as exact.
const EXACT_P: f64 = 1e-9;

/// Returns the distribution of the number of events, for independent events with these probabilities.
fn poisson_binomial(probabilities: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sure = 0;
    let mut distribution = vec![1.0];
    for p in probabilities {
        if p > 1.0 - EXACT_P {
            sure += 1;
        } else if p > EXACT_P {
            distribution.push(0.0);
            for n in (1..distribution.len()).rev() {
                distribution[n] = distribution[n] * (1.0 - p) + distribution[n - 1] * p;
            }
            distribution[0] *= 1.0 - p;
        }
    }
    let mut whole = vec![0.0; sure];
    whole.extend(distribution);
    whole
}

/// Adds the vehicles without a track. If `n` vehicles have tracks, the number of others has a Poisson distribution whose
/// mean is in proportion to `n`.
fn with_missed(distribution: &[f64], missed_share: f64) -> Vec<f64> {
    let mut whole = Vec::new();
    for (n, &p) in distribution.iter().enumerate() {
        let mean = n as f64 * missed_share / (1.0 - missed_share);
        if p == 0.0 {
            continue;
        }
        let mut term = (-mean).exp();
        for more in 0.. {
            if whole.len() <= n + more {
                whole.resize(n + more + 1, 0.0);
            }
            whole[n + more] += p * term;
            term *= mean / (more + 1) as f64;
            if more as f64 > mean && term < EXACT_P {
                break;
            }
        }
    }
    whole
}

fn add(sum: &mut Vec<f64>, other: &[f64], weight: f64) {
    if sum.len() < other.len() {
        sum.resize(other.len(), 0.0);
    }
    sum.iter_mut().zip(other).for_each(|(sum, p)| *sum += weight * p);
}

/// Returns the smallest interval whose tails hold at most 2.5 % each.
fn interval(distribution: &[f64]) -> [u64; 2] {
    let tail = 0.025 * distribution.iter().sum::<f64>();
    let outside = |numbers: &mut dyn Iterator<Item = &f64>| {
        let mut sum = 0.0;
        numbers
            .take_while(|p| {
                sum += **p;
                sum <= tail
            })
            .count()
    };
    let low = outside(&mut distribution.iter());
    let high = distribution.len().saturating_sub(1 + outside(&mut distribution.iter().rev()));
    [low as u64, high.max(low) as u64]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_probabilities_give_the_binomial_distribution() {
        let distribution = poisson_binomial([0.5; 4].into_iter());
        let expected = [1.0, 4.0, 6.0, 4.0, 1.0].map(|n| n / 16.0);
        assert!(distribution.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
        // Sure events only shift the distribution.
        let shifted = poisson_binomial([1.0, 0.5, 0.0, 1.0].into_iter());
        assert_eq!(shifted, [0.0, 0.0, 0.5, 0.5]);
    }

    #[test]
    fn the_interval_holds_95_per_cent() {
        assert_eq!(interval(&[0.0, 0.0, 1.0]), [2, 2]);
        // For 100 events of probability 1/2, the interval is the mean ± 1.96 sds of 5.
        let distribution = poisson_binomial([0.5; 100].into_iter());
        assert_eq!(interval(&distribution), [40, 60]);
    }

    #[test]
    fn missed_vehicles_widen_the_interval_upwards() {
        let mut sure = vec![0.0; 200];
        sure.push(1.0);
        let [low, high] = interval(&with_missed(&sure, 0.02));
        // The mean of the missed vehicles is 4.08. The tails of a Poisson distribution of this mean begin at 1 and 8.
        assert_eq!((low, high), (201, 208));
        assert_eq!(interval(&with_missed(&sure, 0.0)), [200, 200]);
    }
}
