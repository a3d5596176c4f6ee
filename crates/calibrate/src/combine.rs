//! Combines many observations of a stationary car to one set of keypoints.
//!
//! All frames show the same view of the car, so the net makes similar errors in each. A single observation has the
//! covariance C. The share of bias in C is unknown, so all of C counts as bias of the mean. The white noise of the mean
//! of n frames is added. Let r be the scatter over frames divided by C, for all keypoints of the car. Then the mean has
//! the covariance
//!
//! ```text
//! C_mean = C · (1 + r / n_eff),    n_eff = n (1 − ρ) / (1 + ρ)
//! ```
//!
//! The correlation of the scatter from one frame to the next is ρ.

use nalgebra::{Matrix2, Vector2};
use roadplane_base::{KEYPOINTS, Keypoint, KeypointSet, StudentT, median};

/// Robust mean of one keypoint over the frames.
struct Mean {
    /// Mean position, px, its mean score, and the covariance of a single observation, px². Frames without the keypoint
    /// have the score 0.
    point: Keypoint,
    /// Number of frames that contain the keypoint.
    frames: f64,
    /// Sum of w δᵀC⁻¹δ / 2 over the frames, where δ is the deviation from the mean and w the weight.
    scatter: f64,
    /// Sum of δ·δ over the frames, px²; used for ρ.
    own: f64,
    /// Sum of δ·δ' over neighbouring frames, px²; used for ρ.
    lagged: f64,
}

/// Combines the observations of one stationary car, in the order of time. Returns robust means of the keypoints (px) with
/// the covariance that remains (px²).
#[must_use]
pub fn combine(sets: &[&KeypointSet]) -> Box<KeypointSet> {
    let means: Vec<Option<Mean>> = (0..KEYPOINTS).map(|i| mean_of(sets, i)).collect();
    let total = |of: fn(&Mean) -> f64| means.iter().flatten().map(of).sum::<f64>();
    let ratio = total(|mean| mean.scatter) / total(|mean| mean.frames - 1.0).max(1.0);
    let correlation = (total(|mean| mean.lagged) / total(|mean| mean.own).max(1e-300)).clamp(0.0, 0.98);
    let widened = |mean: &Mean| {
        let independent = (mean.frames * (1.0 - correlation) / (1.0 + correlation)).max(1.0);
        Keypoint { covariance_px2: mean.point.covariance_px2 * (1.0 + ratio / independent), ..mean.point }
    };
    Box::new(std::array::from_fn(|i| means[i].as_ref().map(widened)))
}

/// Returns the robust mean of one keypoint.
///
/// `None` where most frames lack the keypoint. Observations with a singular covariance do not count.
fn mean_of(sets: &[&KeypointSet], index: usize) -> Option<Mean> {
    let seen: Vec<(&Keypoint, Matrix2<f64>)> = sets
        .iter()
        .filter_map(|set| set[index].as_ref())
        .filter_map(|point| Some((point, point.covariance_px2.cholesky()?.inverse())))
        .collect();
    if 2 * seen.len() < sets.len() {
        return None;
    }
    let middle = |axis: usize| median(&mut seen.iter().map(|(p, _)| p.pixel[axis]).collect::<Vec<_>>());
    let mut pixel = Vector2::new(middle(0)?, middle(1)?);
    let mut weights = Vec::new();
    for _ in 0..10 {
        let away: Vec<f64> = seen.iter().map(|(p, _)| (p.pixel - pixel).norm()).collect();
        // The median of a Rayleigh variable is 1.1774 sds.
        let sd = (median(&mut away.clone())? / 1.1774).max(1e-9);
        weights = away
            .iter()
            .map(|distance| StudentT { dimensions: 2.0 }.weight((distance / sd).powi(2)))
            .collect();
        let mut sum = Vector2::zeros();
        let mut information = Matrix2::zeros();
        for ((point, inverse), weight) in seen.iter().zip(&weights) {
            information += inverse * *weight;
            sum += inverse * *weight * point.pixel;
        }
        pixel = information.cholesky()?.inverse() * sum;
    }
    // Typical covariance of one observation: the harmonic mean, normalised like the weights.
    let total: Matrix2<f64> = seen.iter().map(|(_, inverse)| inverse).sum();
    let frames = seen.len() as f64;
    let deviations: Vec<Vector2<f64>> = seen.iter().map(|(p, _)| p.pixel - pixel).collect();
    let square = |((_, inverse), d): (&(&Keypoint, Matrix2<f64>), &Vector2<f64>)| d.dot(&(inverse * d));
    let squares = seen.iter().zip(&deviations).map(square).zip(&weights);
    let point = Keypoint {
        pixel,
        score: seen.iter().map(|(point, _)| point.score).sum::<f64>() / sets.len() as f64,
        covariance_px2: total.cholesky()?.inverse() * frames,
    };
    Some(Mean {
        point,
        frames,
        scatter: 0.5 * squares.map(|(square, weight)| square * weight).sum::<f64>(),
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
        // The weights leave 83 % of the squares of Gaussian errors.
        for (white, expected, tolerance) in [(1.0, 0.83, 0.08), (0.2, 0.033, 0.005)] {
            let mut random = Rng::new(1);
            let mut coordinate = || 100.0 + 4.0 * white * random.normal();
            let mut point = || Keypoint {
                pixel: Vector2::new(coordinate(), coordinate()),
                score: 1.0,
                covariance_px2: Matrix2::identity() * 16.0,
            };
            let sets: Vec<KeypointSet> = (0..100).map(|_| std::array::from_fn(|_| Some(point()))).collect();
            let sets: Vec<&KeypointSet> = sets.iter().collect();
            let scatter: f64 = (0..KEYPOINTS).map(|i| mean_of(&sets, i).unwrap().scatter).sum();
            let ratio = scatter / (99 * KEYPOINTS) as f64;
            assert!((ratio - expected).abs() < tolerance, "{ratio} for {white}");
        }
    }
}
