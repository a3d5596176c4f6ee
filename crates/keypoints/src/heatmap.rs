//! Converts a heatmap of logits to a sub-pixel location with covariance.

use nalgebra::{Matrix2, Vector2};
use serde::Deserialize;

/// Number of heatmap cells on each side of the peak that contribute to the mean and the covariance.
const WINDOW_CELLS: isize = 3;

/// Upper limit of the share that the prior may have in a location. The code divides by 1 − share, so a share near 1
/// would amplify noise.
const LARGEST_PRIOR_SHARE: f64 = 0.5;

/// Constants that convert a peak of a heatmap to a measurement with a calibrated covariance.
///
/// They are stored under `calibration` in the net's card. The unit "crop px" is a pixel of the crop that the net reads.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Constant `a` in the covariance `S = a² V² + b²` of the net's mean, 1 / crop px. `V` is the variance of the peak,
    /// crop px².
    pub sd_per_variance: f64,
    /// Constant `b` in the covariance `S = a² V² + b²`, crop px. It is the smallest sd.
    pub sd_floor_crop_px: f64,
    /// Mean location of visible keypoints in rendered crops, which are similar to the training data, crop px.
    pub prior_mean_crop_px: Vector2<f64>,
    /// Standard deviation of the locations of visible keypoints in such crops, in x and y, crop px.
    pub prior_sd_crop_px: Vector2<f64>,
}

impl Calibration {
    /// Whether all numbers are finite. All numbers except the mean location must also be positive.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let (mean, sd) = (self.prior_mean_crop_px, self.prior_sd_crop_px);
        let positive = [self.sd_per_variance, self.sd_floor_crop_px, sd.x, sd.y];
        positive.iter().all(|v| v.is_finite() && *v > 0.0) && mean.iter().all(|v| v.is_finite())
    }

    /// Returns the measurement that explains a peak with the mean m (crop px) and the variance V (crop px²).
    ///
    /// A trained net returns the mean m of a posterior distribution. The prior over all crops has the mean c and the
    /// covariance P. This prior shifts m towards c, the middle of the crop. Without a correction, cars would appear
    /// smaller and farther away than they are. With the posterior covariance `S = a² V² + b²`, the measurement is
    /// `c + (1 − S P⁻¹)⁻¹ (m − c)`. Its covariance is `(S⁻¹ − P⁻¹)⁻¹`.
    #[must_use]
    pub fn measurement(&self, mean: Vector2<f64>, variance: Matrix2<f64>) -> Peak {
        let sd = Matrix2::from_diagonal(&self.prior_sd_crop_px);
        let per_sd = Matrix2::from_diagonal(&self.prior_sd_crop_px.map(f64::recip));
        let posterior = variance * variance * self.sd_per_variance.powi(2)
            + Matrix2::identity() * self.sd_floor_crop_px.powi(2);
        let share = (per_sd * posterior * per_sd).symmetric_eigen();
        let rest = share.eigenvalues.map(|v| 1.0 - v.min(LARGEST_PRIOR_SHARE));
        let (axes, across) = (sd * share.eigenvectors, share.eigenvectors.transpose() * per_sd);
        Peak {
            crop_px: self.prior_mean_crop_px
                + axes * (across * (mean - self.prior_mean_crop_px)).component_div(&rest),
            covariance: axes
                * Matrix2::from_diagonal(&share.eigenvalues.component_div(&rest))
                * axes.transpose(),
        }
    }
}

/// Converts heatmaps of the keypoint net to locations (see "Keypoint net" in `docs/book/developers/architecture.md`).
#[derive(Clone, Debug, PartialEq)]
pub struct HeatmapDecoder {
    /// Side of the heatmap, cells.
    pub cells: usize,
    /// Crop pixels per heatmap cell.
    pub stride_px: f64,
    /// Constants that convert a peak to a measurement.
    pub calibration: Calibration,
}

/// A keypoint's location in crop pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Location, crop px.
    pub crop_px: Vector2<f64>,
    /// Covariance of the location, crop px².
    pub covariance: Matrix2<f64>,
}

impl HeatmapDecoder {
    /// Returns the location of a keypoint from its heatmap. `logits` contains `cells × cells` numbers, row by row.
    ///
    /// Returns `None` if no logit is finite.
    #[must_use]
    pub fn decode(&self, logits: &[f32]) -> Option<Peak> {
        let (mean, variance) = self.moments(logits)?;
        Some(self.calibration.measurement(mean, variance))
    }

    /// Returns the mean (crop px) and the variance (crop px²) of the softmax of `logits`, within a window around the
    /// peak.
    fn moments(&self, logits: &[f32]) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let (peak, top) = logits.iter().enumerate().filter(|(_, v)| v.is_finite()).fold(
            None,
            |best: Option<(usize, f32)>, (i, &v)| match best {
                Some((_, top)) if v <= top => best,
                _ => Some((i, v)),
            },
        )?;
        let side = self.cells as isize;
        let (row, column) = ((peak / self.cells) as isize, (peak % self.cells) as isize);
        let near = |middle: isize| (middle - WINDOW_CELLS).max(0)..(middle + WINDOW_CELLS + 1).min(side);
        let mut mass = 0.0;
        let mut mean = Vector2::zeros();
        let mut second = Matrix2::zeros();
        for r in near(row) {
            for c in near(column) {
                let p = f64::from(logits[(r * side + c) as usize] - top).exp();
                let offset = Vector2::new((c - column) as f64, (r - row) as f64);
                mass += p;
                mean += p * offset;
                second += p * offset * offset.transpose();
            }
        }
        mean /= mass;
        let variance = (second / mass - mean * mean.transpose()) * (self.stride_px * self.stride_px);
        let cell = Vector2::new(column as f64, row as f64) + mean;
        Some(((cell * self.stride_px).add_scalar((self.stride_px - 1.0) / 2.0), variance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DECODER: HeatmapDecoder = HeatmapDecoder {
        cells: 32,
        stride_px: 4.0,
        calibration: Calibration {
            sd_per_variance: 0.2,
            sd_floor_crop_px: 0.5,
            prior_mean_crop_px: Vector2::new(63.0, 60.0),
            prior_sd_crop_px: Vector2::new(32.0, 19.0),
        },
    };

    fn gaussian(at: Vector2<f64>, sd_px: f64) -> Vec<f32> {
        (0..32 * 32)
            .map(|i| {
                let cell = Vector2::new(f64::from(i % 32), f64::from(i / 32)) * 4.0;
                (-(cell.add_scalar(1.5) - at).norm_squared() / (2.0 * sd_px * sd_px)) as f32
            })
            .collect()
    }

    #[test]
    fn a_gaussian_is_found_between_cells_with_its_sd() {
        for (x, y) in [(40.0, 60.0), (41.3, 62.9), (77.7, 30.2)] {
            let (mean, variance) = DECODER.moments(&gaussian(Vector2::new(x, y), 4.0)).unwrap();
            assert!((mean - Vector2::new(x, y)).norm() < 0.08, "{mean:?}");
            assert!((variance[(0, 0)].sqrt() - 4.0).abs() < 0.3, "{variance:?}");
            assert!(variance[(0, 1)].abs() < 0.1);
        }
    }

    #[test]
    fn a_measurement_together_with_the_prior_gives_the_posterior_back() {
        let calibration = &DECODER.calibration;
        let (mean, variance) = (Vector2::new(80.0, 30.0), Matrix2::new(20.0, 6.0, 6.0, 11.0));
        let peak = calibration.measurement(mean, variance);
        let prior = Matrix2::from_diagonal(&calibration.prior_sd_crop_px.map(|sd| sd * sd));
        let (of_peak, of_prior) = (peak.covariance.try_inverse().unwrap(), prior.try_inverse().unwrap());
        let posterior = (of_peak + of_prior).try_inverse().unwrap();
        let expected = variance * variance * 0.04 + Matrix2::identity() * 0.25;
        assert!((posterior - expected).norm() < 1e-9, "{posterior}");
        let back = posterior * (of_peak * peak.crop_px + of_prior * calibration.prior_mean_crop_px);
        assert!((back - mean).norm() < 1e-9, "{back}");
    }

    #[test]
    fn unsound_calibrations_are_rejected() {
        let sound = &DECODER.calibration;
        assert!(sound.is_sound());
        assert!(!Calibration { sd_per_variance: 0.0, ..sound.clone() }.is_sound());
        assert!(!Calibration { prior_sd_crop_px: Vector2::new(32.0, f64::NAN), ..sound.clone() }.is_sound());
        let short = r#"{"sd_per_variance": 0.2, "sd_floor_crop_px": 0.5, "prior_mean_crop_px": [63.0], "prior_sd_crop_px": [32, 19]}"#;
        assert!(serde_json::from_str::<Calibration>(short).is_err());
        let whole = short.replace("[63.0]", "[63.0, 60.0]");
        assert_eq!(&serde_json::from_str::<Calibration>(&whole).unwrap(), sound);
    }

    /// A heatmap in `tests/data/decoding.json` with its expected results. The tests of the Python code use the same
    /// file.
    #[derive(Deserialize)]
    struct Case {
        name: String,
        logits: Vec<f32>,
        mean_crop_px: [f64; 2],
        variance_crop_px2: [f64; 3],
        location_crop_px: [f64; 2],
        covariance_crop_px2: [f64; 3],
    }

    #[derive(Deserialize)]
    struct Fixture {
        cells: usize,
        stride_px: f64,
        calibration: Calibration,
        cases: Vec<Case>,
    }

    #[test]
    fn rust_and_python_decode_heatmaps_alike() {
        let Fixture { cells, stride_px, calibration, cases } =
            serde_json::from_str(include_str!("../../../tests/data/decoding.json")).unwrap();
        let decoder = HeatmapDecoder { cells, stride_px, calibration };
        assert!(cases.len() >= 4);
        for case in cases {
            let mut logits = vec![-20.0; cells * cells];
            for entry in case.logits.chunks_exact(3) {
                logits[entry[0] as usize * cells + entry[1] as usize] = entry[2];
            }
            let (mean, variance) = decoder.moments(&logits).unwrap();
            let peak = decoder.decode(&logits).unwrap();
            let near =
                |what: &str, (x, y): (f64, f64), matrix: Matrix2<f64>, at: [f64; 2], spread: [f64; 3]| {
                    let found = [x, y, matrix[(0, 0)], matrix[(0, 1)], matrix[(1, 1)]];
                    for (found, expected) in found.iter().zip(at.iter().chain(&spread)) {
                        assert!((found - expected).abs() < 1e-4, "{}, {what}: {found} {expected}", case.name);
                    }
                };
            near("softmax", (mean.x, mean.y), variance, case.mean_crop_px, case.variance_crop_px2);
            let at = (peak.crop_px.x, peak.crop_px.y);
            near("keypoint", at, peak.covariance, case.location_crop_px, case.covariance_crop_px2);
        }
    }

    #[test]
    fn a_flat_heatmap_stays_finite() {
        let peak = DECODER.calibration.measurement(Vector2::new(80.0, 30.0), Matrix2::identity() * 1e4);
        assert!((peak.crop_px - Vector2::new(97.0, 0.0)).norm() < 1e-9, "twice as far from the middle");
        assert!(peak.covariance[(0, 0)] > 1e6);
    }

    #[test]
    fn a_heatmap_without_numbers_has_no_keypoint() {
        assert_eq!(DECODER.decode(&vec![f32::NAN; 32 * 32]), None);
        assert!(DECODER.decode(&vec![0.0; 32 * 32]).is_some());
    }
}
