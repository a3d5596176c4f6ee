//! How far each car is trusted to tell the camera.
//!
//! The atlas knows most cars well and some hardly. A car that it does not know still looks like some car, of another size or
//! seen from another height, and a few of them can turn the camera. What tells them is that they fit worse than the others of
//! the picture. So the keypoints and the shape of a car are not taken for normal but for Student-t distributed as one vector:
//! normal, with a variance factor of its own, to be found with everything else (Lange, Little and Taylor 1989, J. Am. Stat.
//! Assoc. 84). For a car of n measured numbers and squared distance d² this is the normal problem with its cost times
//!
//! ```text
//! w = (ν + n) / (ν + d²)
//! ```
//!
//! The sds of a picture's keypoints may all be too wide; so d²/n is counted in units of the picture's median. Where that is
//! above 1, all its cars count less.

/// Added to every d²/n: how much better than this a car fits says nothing of it.
const EXACT: f64 = 0.05;

/// How well a car fits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CarFit {
    /// d²: squared whitened residuals and shape coefficients, robust.
    pub squared: f64,
    /// n: measured numbers, two a keypoint, by the keypoint's weight.
    pub numbers: f64,
}

/// The weight of each car; 1 where `freedom` (ν) is infinite.
pub(crate) fn trust(cars: &[CarFit], freedom: f64) -> Vec<f64> {
    if freedom.is_infinite() || cars.is_empty() {
        return vec![1.0; cars.len()];
    }
    let ratio = |car: &CarFit| car.squared / car.numbers.max(1.0);
    let mut ratios: Vec<f64> = cars.iter().map(ratio).collect();
    ratios.sort_by(f64::total_cmp);
    let median = (ratios[(ratios.len() - 1) / 2] + ratios[ratios.len() / 2]) / 2.0;
    let unit = median.min(1.0) + EXACT;
    let weight = |car: &CarFit| {
        let squared = car.numbers * (ratio(car) + EXACT) / unit;
        (freedom + car.numbers) / (freedom + squared)
    };
    cars.iter().map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cars(squared: &[f64]) -> Vec<CarFit> {
        squared.iter().map(|squared| CarFit { squared: *squared, numbers: 40.0 }).collect()
    }

    #[test]
    fn a_car_that_fits_like_the_others_counts_once() {
        for level in [4.0, 20.0, 40.0] {
            for weight in trust(&cars(&[level; 5]), 4.0) {
                assert!((weight - 1.0).abs() < 1e-12);
            }
        }
        assert_eq!(trust(&cars(&[1.0, 400.0]), f64::INFINITY), [1.0, 1.0]);
        assert!(trust(&[], 4.0).is_empty());
    }

    #[test]
    fn a_car_that_fits_worse_counts_less() {
        let weights = trust(&cars(&[8.0, 10.0, 40.0, 12.0, 10.0]), 4.0);
        assert!(weights[2] < 0.35 && weights[0] > 1.0 && weights[0] > weights[3]);
    }

    #[test]
    fn a_picture_that_fits_badly_counts_less() {
        for weight in trust(&cars(&[160.0; 3]), 4.0) {
            assert!((0.26..0.28).contains(&weight));
        }
    }

    #[test]
    fn perfect_fits_are_all_alike() {
        for weight in trust(&cars(&[0.0, 0.1, 1e-300]), 4.0) {
            assert!((weight - 1.0).abs() < 0.05);
        }
        let none = CarFit { squared: 0.0, numbers: 0.0 };
        assert_eq!(trust(&[none], 4.0), [1.0]);
    }
}
