//! Combines many observations of a stationary car to one set of keypoints.
//!
//! A predicted covariance C covers the keypoint's whole error. Over frames of the same view only the white part of the
//! error is visible. Let `r` be the scatter over frames divided by C. Then the mean of n frames has the covariance
//!
//! ```text
//! C_mean = C · ( max(1 − r, β²) + r / n_eff ),    n_eff = n (1 − ρ) / (1 + ρ)
//! ```
//!
//! Here β ([`BIAS_SHARE`]) is the least share of the sd that counts as bias. The correlation of the scatter from one
//! frame to the next is ρ. An `r` above 1 means that C was too small; it widens C.

use nalgebra::{Matrix2, Vector2};
use roadplane_base::{KEYPOINTS, Keypoint, KeypointSet, StudentT, median};

/// Least share β of a keypoint's sd that counts as bias, which does not average out over frames.
const BIAS_SHARE: f64 = 0.6;
/// Least number of frames of a keypoint for which the scatter is evaluated.
const MIN_FRAMES: usize = 3;
/// A keypoint that is found in a smaller share of the frames is left out.
const MIN_PRESENCE: f64 = 0.3;
/// Error model of a keypoint's observations; the scale comes from their median distance.
const SCATTER: StudentT = StudentT { dimensions: 2.0 };
/// An observation farther away than this counts as this far in the scatter, sds.
const MAX_SD: f64 = 3.0;
/// Weight of the car's mean scatter ratio in the ratio of each keypoint, in frames.
const POOLED_FRAMES: f64 = 5.0;

/// Robust mean of one keypoint over the frames.
struct Mean {
    /// Mean position, px.
    pixel: Vector2<f64>,
    /// Covariance of a single observation, px².
    covariance: Matrix2<f64>,
    /// Mean score over all frames; frames without the keypoint count as 0.
    score: f64,
    /// Number of frames that contain the keypoint.
    frames: usize,
    /// Mean of δᵀC⁻¹δ / 2 over the frames, where δ is the deviation from the mean.
    scatter: f64,
    /// Sum of δ·δ over the frames, px²; used for ρ.
    own: f64,
    /// Sum of δ·δ' over neighbouring frames, px²; used for ρ.
    lagged: f64,
}

/// Combines the observations of one stationary car, given in the order of time, to robust means of the keypoints (px)
/// with the covariance that remains (px²).
#[must_use]
pub fn combine(looks: &[&KeypointSet]) -> Box<KeypointSet> {
    let means: Vec<Option<Mean>> = (0..KEYPOINTS).map(|i| mean_of(looks, i)).collect();
    let several = || means.iter().flatten().filter(|mean| mean.frames >= MIN_FRAMES);
    let frames: f64 = several().map(|m| m.frames as f64).sum();
    let pooled = several().map(|m| m.frames as f64 * m.scatter).sum::<f64>() / frames.max(1.0);
    let own: f64 = several().map(|m| m.own).sum();
    let correlation = (several().map(|m| m.lagged).sum::<f64>() / own.max(1e-300)).clamp(0.0, 0.98);
    let reduced = |mean: &Mean| {
        let n = mean.frames as f64;
        let factor = if mean.frames < MIN_FRAMES {
            1.0
        } else {
            let ratio = (n * mean.scatter + POOLED_FRAMES * pooled) / (n + POOLED_FRAMES);
            let independent = (n * (1.0 - correlation) / (1.0 + correlation)).max(1.0);
            (1.0 - ratio).max(BIAS_SHARE * BIAS_SHARE) + ratio / independent
        };
        Keypoint { pixel: mean.pixel, score: mean.score, covariance_px2: mean.covariance * factor }
    };
    Box::new(std::array::from_fn(|i| means[i].as_ref().map(reduced)))
}

/// Returns the robust mean of one keypoint, with the covariance of a single observation.
///
/// `None` where the keypoint is found too seldom or a covariance is singular.
fn mean_of(looks: &[&KeypointSet], index: usize) -> Option<Mean> {
    let seen: Vec<(&Keypoint, Matrix2<f64>)> = looks
        .iter()
        .filter_map(|set| set[index].as_ref())
        .filter_map(|point| Some((point, point.covariance_px2.cholesky()?.inverse())))
        .collect();
    let frames = seen.len();
    if frames == 0 || (frames as f64) < MIN_PRESENCE * looks.len() as f64 {
        return None;
    }
    let middle = |axis: usize| median(&mut seen.iter().map(|(p, _)| p.pixel[axis]).collect::<Vec<_>>());
    let mut pixel = Vector2::new(middle(0)?, middle(1)?);
    let mut sd = 0.0;
    for _ in 0..10 {
        let away: Vec<f64> = seen.iter().map(|(p, _)| (p.pixel - pixel).norm()).collect();
        // The median of a Rayleigh variable is 1.1774 sds.
        sd = (median(&mut away.clone())? / 1.1774).max(1e-9);
        let mut sum = Vector2::zeros();
        let mut information = Matrix2::zeros();
        for ((point, inverse), distance) in seen.iter().zip(&away) {
            let weight = SCATTER.weight((distance / sd).powi(2));
            information += inverse * weight;
            sum += inverse * weight * point.pixel;
        }
        pixel = information.cholesky()?.inverse() * sum;
    }
    // Typical covariance of one observation: the harmonic mean, normalised like the weights.
    let total: Matrix2<f64> = seen.iter().map(|(_, inverse)| inverse).sum();
    let covariance = total.cholesky()?.inverse() * frames as f64;
    let deviations: Vec<Vector2<f64>> = seen.iter().map(|(p, _)| p.pixel - pixel).collect();
    let within = |d: &Vector2<f64>| (MAX_SD * sd / d.norm().max(1e-12)).powi(2).min(1.0);
    let squares: f64 =
        seen.iter().zip(&deviations).map(|((_, inverse), d)| d.dot(&(inverse * d)) * within(d)).sum();
    Some(Mean {
        pixel,
        covariance,
        score: seen.iter().map(|(p, _)| p.score).sum::<f64>() / looks.len() as f64,
        frames,
        scatter: 0.5 * squares / (frames as f64 - 1.0).max(1.0),
        own: deviations.iter().map(Vector2::norm_squared).sum(),
        lagged: deviations.windows(2).map(|pair| pair[0].dot(&pair[1])).sum(),
    })
}

#[cfg(test)]
mod tests {
    use roadplane_synth::Rng;

    use super::*;

    #[test]
    fn the_scatter_is_relative_to_the_prediction() {
        for (white, expected, tolerance) in [(1.0, 1.0, 0.1), (0.2, 0.04, 0.01)] {
            let mut random = Rng::new(1);
            let mut coordinate = || 100.0 + 4.0 * white * random.normal();
            let mut point = || Keypoint {
                pixel: Vector2::new(coordinate(), coordinate()),
                score: 1.0,
                covariance_px2: Matrix2::identity() * 16.0,
            };
            let looks: Vec<KeypointSet> = (0..100).map(|_| std::array::from_fn(|_| Some(point()))).collect();
            let looks: Vec<&KeypointSet> = looks.iter().collect();
            let scatter: f64 = (0..KEYPOINTS).map(|i| mean_of(&looks, i).unwrap().scatter).sum();
            let ratio = scatter / KEYPOINTS as f64;
            assert!((ratio - expected).abs() < tolerance, "{ratio} for {white}");
        }
    }
}
