//! A frame at another scale, as the net wants it: planes of f32 in 0…1.

use image::RgbImage;

/// A picture as three planes, values 0–1.
#[derive(Clone, Debug)]
pub(crate) struct Planes {
    pub width: usize,
    pub height: usize,
    /// `[channel][row][column]`.
    pub values: Vec<f32>,
}

/// Weights of the source pixels that make one target pixel.
struct Kernel {
    first: usize,
    weights: Vec<f32>,
}

/// Area average along one axis: every target pixel is the mean of what it covers, with parts of pixels at its ends.
/// Pixel `i` covers `[i, i + 1)` in both, so that centres correspond as `(u + 0.5) · source / target − 0.5`.
fn kernels(source: usize, target: usize) -> Vec<Kernel> {
    let step = source as f64 / target as f64;
    (0..target)
        .map(|u| {
            let (from, to) = (u as f64 * step, (u as f64 + 1.0) * step);
            let first = (from.floor() as usize).min(source - 1);
            let last = (to.ceil() as usize).clamp(first + 1, source);
            let covered = |i: usize| (to.min(i as f64 + 1.0) - from.max(i as f64)).max(0.0) / step;
            Kernel { first, weights: (first..last).map(|i| covered(i) as f32).collect() }
        })
        .collect()
}

/// The frame resampled to a size of at least 1 × 1 and at most its own.
pub(crate) fn resample(image: &RgbImage, width: usize, height: usize) -> Planes {
    let (source_width, source_height) = (image.width() as usize, image.height() as usize);
    let bytes = image.as_raw();
    let mut values = vec![0.0_f32; 3 * width * height];
    if (source_width, source_height) == (width, height) {
        let (red, rest) = values.split_at_mut(width * height);
        let (green, blue) = rest.split_at_mut(width * height);
        for (((pixel, r), g), b) in bytes.chunks_exact(3).zip(red).zip(green).zip(blue) {
            (*r, *g, *b) =
                (f32::from(pixel[0]) / 255.0, f32::from(pixel[1]) / 255.0, f32::from(pixel[2]) / 255.0);
        }
        return Planes { width, height, values };
    }
    let columns = kernels(source_width, width);
    // Down first, into one row of source width, then along it.
    let mut row = vec![0.0_f32; 3 * source_width];
    for (y, kernel) in kernels(source_height, height).iter().enumerate() {
        row.fill(0.0);
        for (k, weight) in kernel.weights.iter().enumerate() {
            let from = (kernel.first + k) * 3 * source_width;
            for (sum, byte) in row.iter_mut().zip(&bytes[from..from + 3 * source_width]) {
                *sum += weight / 255.0 * f32::from(*byte);
            }
        }
        for (x, kernel) in columns.iter().enumerate() {
            let mut sums = [0.0_f32; 3];
            for (pixel, weight) in row[3 * kernel.first..].chunks_exact(3).zip(&kernel.weights) {
                for (sum, value) in sums.iter_mut().zip(pixel) {
                    *sum += weight * value;
                }
            }
            for (channel, sum) in sums.into_iter().enumerate() {
                values[(channel * height + y) * width + x] = sum;
            }
        }
    }
    Planes { width, height, values }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp along x and y, which resampling must keep at the right place, to the part of a step that averaging costs.
    fn ramp(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| image::Rgb([(2 * x) as u8, (3 * y) as u8, 100]))
    }

    #[test]
    fn centres_stay_where_they_are() {
        let image = ramp(100, 60);
        for (width, height) in [(100, 60), (50, 30), (75, 45), (67, 40), (33, 19)] {
            let planes = resample(&image, width, height);
            for (x, y) in [(width / 2, height / 2), (width / 3, height / 4)] {
                let centre =
                    |u: usize, source: f64, target: usize| (u as f64 + 0.5) * source / target as f64 - 0.5;
                let red = f64::from(planes.values[y * width + x]) * 255.0;
                let green = f64::from(planes.values[(height + y) * width + x]) * 255.0;
                assert!((red - 2.0 * centre(x, 100.0, width)).abs() < 0.2, "{width}: {red}");
                assert!((green - 3.0 * centre(y, 60.0, height)).abs() < 0.3, "{height}: {green}");
                assert!((planes.values[(2 * height + y) * width + x] * 255.0 - 100.0).abs() < 1e-3);
            }
        }
    }
}
