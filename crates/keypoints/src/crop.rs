//! The square crop that the net reads, and the conversion between pixels of the crop and pixels of the frame.

use image::RgbImage;
use nalgebra::{Matrix2, Vector2};

/// Side of the net's input, px.
pub const CROP_PX: usize = 128;

/// Value of crop pixels outside the frame.
const OUTSIDE: f32 = 0.5;

/// A square of the frame that is resampled to [`CROP_PX`] × [`CROP_PX`].
///
/// Column u of the crop lies at `x = centre + ((u + 0.5) / CROP_PX − 0.5) · side` in the frame. Rows follow the same
/// formula. In the crop and in the frame, (0, 0) is the centre of the top-left pixel. A mirrored crop has its columns
/// in reverse order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquareCrop {
    /// Centre in the frame, px.
    pub centre_px: Vector2<f64>,
    /// Side in the frame, px.
    pub side_px: f64,
    /// Whether left and right are exchanged.
    pub mirrored: bool,
}

impl SquareCrop {
    /// Returns the crop around a box (left, top, right, bottom, px). Its side is `context` times the longer side of the
    /// box.
    #[must_use]
    pub fn around([x0, y0, x1, y1]: [f64; 4], context: f64) -> Self {
        Self {
            centre_px: Vector2::new((x0 + x1) / 2.0, (y0 + y1) / 2.0),
            side_px: context * (x1 - x0).max(y1 - y0).max(1.0),
            mirrored: false,
        }
    }

    /// Returns the number of frame pixels per crop pixel.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.side_px / CROP_PX as f64
    }

    /// Converts a crop pixel to a frame pixel.
    #[must_use]
    pub fn frame_from_crop(&self, crop_px: Vector2<f64>) -> Vector2<f64> {
        let half = CROP_PX as f64 / 2.0;
        let mut from_centre = crop_px.add_scalar(0.5 - half);
        if self.mirrored {
            from_centre.x = -from_centre.x;
        }
        self.centre_px + from_centre * self.scale()
    }

    /// Converts a covariance from pixels of the crop (px²) to pixels of the frame (px²).
    #[must_use]
    pub fn covariance_in_frame(&self, mut crop_px2: Matrix2<f64>) -> Matrix2<f64> {
        if self.mirrored {
            crop_px2[(0, 1)] = -crop_px2[(0, 1)];
            crop_px2[(1, 0)] = -crop_px2[(1, 0)];
        }
        crop_px2 * (self.scale() * self.scale())
    }

    /// Resamples the crop into `out`: planes R, G and B, each with `CROP_PX²` values from 0 to 1.
    ///
    /// `out` must have the length `3 · CROP_PX²`. A crop that is enlarged is resampled bilinearly. A crop that is
    /// reduced is resampled by area averages.
    pub fn sample_into(&self, image: &RgbImage, out: &mut [f32]) {
        let mut columns = Taps::new(self.centre_px.x, self.side_px, image.width());
        if self.mirrored {
            columns.of_pixel.reverse();
        }
        let rows = Taps::new(self.centre_px.y, self.side_px, image.height());
        let stride = image.width() as usize * 3;
        let pixels = image.as_raw();
        let plane = CROP_PX * CROP_PX;
        let first_row = rows.lowest();
        // The horizontal pass covers only the rows that are needed; the vertical pass follows.
        let strips: Vec<[f32; 3]> = (first_row..rows.end())
            .flat_map(|y| {
                let line = &pixels[y * stride..(y + 1) * stride];
                columns.of_pixel.iter().map(move |taps| {
                    let mut sum = [0.0f32; 3];
                    for &(x, weight) in taps {
                        for (s, v) in sum.iter_mut().zip(&line[3 * x..3 * x + 3]) {
                            *s += weight * f32::from(*v);
                        }
                    }
                    sum
                })
            })
            .collect();
        for (v, row_taps) in rows.of_pixel.iter().enumerate() {
            let row_inside: f32 = row_taps.iter().map(|tap| tap.1).sum();
            for (u, column_taps) in columns.of_pixel.iter().enumerate() {
                let inside = row_inside * column_taps.iter().map(|tap| tap.1).sum::<f32>();
                for channel in 0..3 {
                    let sum: f32 = row_taps
                        .iter()
                        .map(|&(y, weight)| weight * strips[(y - first_row) * CROP_PX + u][channel])
                        .sum();
                    out[channel * plane + v * CROP_PX + u] = sum / 255.0 + (1.0 - inside) * OUTSIDE;
                }
            }
        }
    }
}

/// Weights of the resampling along one axis. Each crop pixel has a list of the frame pixels that contribute to it. The
/// weights of a list sum to at most 1.
struct Taps {
    of_pixel: Vec<Vec<(usize, f32)>>,
}

impl Taps {
    fn new(centre_px: f64, side_px: f64, length: u32) -> Self {
        let scale = side_px / CROP_PX as f64;
        let inside = |i: f64| i >= 0.0 && i < f64::from(length);
        let of_pixel = (0..CROP_PX)
            .map(|u| {
                let middle = centre_px + ((u as f64 + 0.5) / CROP_PX as f64 - 0.5) * side_px;
                // The weight is the overlap between the frame pixel and an interval that is one crop pixel wide. If the
                // crop is enlarged, the interval is one frame pixel wide, which is bilinear.
                let reach = scale.max(1.0) / 2.0;
                let (from, to) = (middle - reach, middle + reach);
                let mut taps = Vec::new();
                let mut i = (from + 0.5).floor();
                while i - 0.5 < to {
                    let overlap = ((i + 0.5).min(to) - (i - 0.5).max(from)) / (2.0 * reach);
                    if overlap > 0.0 && inside(i) {
                        taps.push((i as usize, overlap as f32));
                    }
                    i += 1.0;
                }
                taps
            })
            .collect();
        Self { of_pixel }
    }

    fn lowest(&self) -> usize {
        self.of_pixel.iter().flatten().map(|tap| tap.0).min().unwrap_or(0)
    }

    fn end(&self) -> usize {
        self.of_pixel.iter().flatten().map(|tap| tap.0 + 1).max().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 100]))
    }

    fn sample(crop: SquareCrop, image: &RgbImage) -> Vec<f32> {
        let mut out = vec![f32::NAN; 3 * CROP_PX * CROP_PX];
        crop.sample_into(image, &mut out);
        out
    }

    #[test]
    fn a_ramp_is_reproduced_at_any_scale() {
        let image = ramp(250, 250);
        for (side_px, mirrored) in [(20.0, false), (97.3, true), (128.0, false), (200.0, true)] {
            let crop = SquareCrop { centre_px: Vector2::new(120.3, 110.7), side_px, mirrored };
            let out = sample(crop, &image);
            for (u, v) in [(10usize, 20usize), (64, 64), (100, 90)] {
                let at = crop.frame_from_crop(Vector2::new(u as f64, v as f64));
                let index = v * CROP_PX + u;
                assert!((f64::from(out[index]) * 255.0 - at.x).abs() < 0.3, "{side_px} {u} {v}");
                assert!((f64::from(out[CROP_PX * CROP_PX + index]) * 255.0 - at.y).abs() < 0.3);
            }
        }
    }

    #[test]
    fn outside_the_frame_is_grey() {
        let out = sample(SquareCrop::around([-50.0, -50.0, 50.0, 50.0], 1.0), &ramp(250, 250));
        assert!((out[0] - OUTSIDE).abs() < 1e-6);
        let far = sample(SquareCrop::around([-950.0, -950.0, -850.0, -850.0], 1.0), &ramp(250, 250));
        assert!(far.iter().all(|v| (v - OUTSIDE).abs() < 1e-6));
    }
}
