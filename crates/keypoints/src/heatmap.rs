//! From a heatmap of logits to a sub-pixel location with covariance.

use nalgebra::{Matrix2, Vector2};

/// Cells on each side of the peak that take part in mean and covariance.
const WINDOW_CELLS: isize = 3;

/// How a net's heatmaps are read; see `ARCHITECTURE.md`, "Keypoint net".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatmapDecoder {
    /// Side of the heatmap, cells.
    pub cells: usize,
    /// Crop pixels per cell.
    pub stride_px: f64,
    /// `a` of `sd² = a² · variance + b²`.
    pub sd_scale: f64,
    /// `b` of the same, crop px.
    pub sd_floor_crop_px: f64,
}

/// A keypoint in crop pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Location, crop px.
    pub crop_px: Vector2<f64>,
    /// Covariance of the location, crop px².
    pub covariance: Matrix2<f64>,
}

impl HeatmapDecoder {
    /// Mean and covariance of the softmax of `logits` (`cells × cells`, row by row) within a window around its peak.
    /// `None` if there is no largest logit (all NaN).
    #[must_use]
    pub fn decode(&self, logits: &[f32]) -> Option<Peak> {
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
        Some(Peak {
            crop_px: (cell * self.stride_px).add_scalar((self.stride_px - 1.0) / 2.0),
            covariance: variance * (self.sd_scale * self.sd_scale)
                + Matrix2::identity() * (self.sd_floor_crop_px * self.sd_floor_crop_px),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DECODER: HeatmapDecoder =
        HeatmapDecoder { cells: 32, stride_px: 4.0, sd_scale: 1.0, sd_floor_crop_px: 0.0 };

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
            let peak = DECODER.decode(&gaussian(Vector2::new(x, y), 4.0)).unwrap();
            assert!((peak.crop_px - Vector2::new(x, y)).norm() < 0.08, "{peak:?}");
            assert!((peak.covariance[(0, 0)].sqrt() - 4.0).abs() < 0.3, "{peak:?}");
            assert!(peak.covariance[(0, 1)].abs() < 0.1);
        }
    }

    #[test]
    fn the_floor_and_scale_of_the_card_are_applied() {
        let decoder = HeatmapDecoder { sd_scale: 2.0, sd_floor_crop_px: 3.0, ..DECODER };
        let logits = gaussian(Vector2::new(50.0, 50.0), 4.0);
        let (plain, scaled) = (DECODER.decode(&logits).unwrap(), decoder.decode(&logits).unwrap());
        let expected = plain.covariance[(0, 0)] * 4.0 + 9.0;
        assert!((scaled.covariance[(0, 0)] - expected).abs() < 1e-9);
    }

    #[test]
    fn nothing_is_made_of_nothing() {
        assert_eq!(DECODER.decode(&vec![f32::NAN; 32 * 32]), None);
        assert!(DECODER.decode(&vec![0.0; 32 * 32]).is_some());
    }
}
