//! How far each car is trusted to tell the camera.
//!
//! The atlas knows most cars well and some hardly. A car that it does not know still looks like some car, of another size or
//! seen from another height, and a few of them can turn the camera. What tells them is that they fit worse than the others of
//! the picture. So the keypoints and the shape of a car are taken for Student-t distributed as one vector: normal, with a
//! variance factor of its own. Reweighted by turns (as in Lange, Little and Taylor 1989, J. Am. Stat. Assoc. 84) this is the
//! normal problem with the cost of a car, of n measured numbers and squared distance d², times
//!
//! ```text
//! w = (ν + n) / (ν + n q)        q = (d²/n + ε) / (min(median d²/n, 1) + ε)
//! ```
//!
//! The sds of a picture's keypoints may all be too wide, so a car is compared with the picture's median; where that is above
//! 1, all cars count less. Only what the cars say of the camera is weighed: the sds of a car's own pose and shape are given the
//! camera and as its keypoints claim.

use roadplane_base::{StudentT, median};

/// ε: differences between fits much closer than this are not counted.
const CLOSE: f64 = 0.05;

/// How well a car fits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Misfit {
    /// d²: squared whitened residuals and shape coefficients, robust.
    pub squared: f64,
    /// n: measured numbers, two a keypoint, by the keypoint's weight.
    pub numbers: f64,
}

impl Misfit {
    /// w of a car whose sds are believed (q = d²/n): what its keypoints are worth.
    pub fn worth(&self) -> f64 {
        StudentT { dimensions: self.numbers }.weight(self.squared)
    }
}

/// The weight of each car.
pub(crate) fn trust(cars: &[Misfit]) -> Vec<f64> {
    let ratios: Vec<f64> = cars.iter().map(|car| car.squared / car.numbers.max(1.0)).collect();
    let unit = median(&mut ratios.clone()).unwrap_or(1.0).min(1.0) + CLOSE;
    let weight = |(car, ratio): (&Misfit, &f64)| {
        StudentT { dimensions: car.numbers }.weight(car.numbers * (ratio + CLOSE) / unit)
    };
    cars.iter().zip(&ratios).map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cars(squared: &[f64]) -> Vec<Misfit> {
        squared.iter().map(|squared| Misfit { squared: *squared, numbers: 40.0 }).collect()
    }

    #[test]
    fn a_car_that_fits_like_the_others_counts_once() {
        for level in [4.0, 20.0, 40.0] {
            for weight in trust(&cars(&[level; 5])) {
                assert!((weight - 1.0).abs() < 1e-12);
            }
        }
        assert!(trust(&[]).is_empty());
    }

    #[test]
    fn a_car_that_fits_worse_counts_less() {
        let weights = trust(&cars(&[8.0, 10.0, 40.0, 12.0, 10.0]));
        assert!(weights[2] < 0.35 && weights[0] > 1.0 && weights[0] > weights[3]);
    }

    #[test]
    fn a_picture_that_fits_badly_counts_less() {
        for weight in trust(&cars(&[160.0; 3])) {
            assert!((0.26..0.28).contains(&weight));
        }
    }

    #[test]
    fn perfect_fits_are_all_alike() {
        for weight in trust(&cars(&[0.0, 0.1, 1e-300])) {
            assert!((weight - 1.0).abs() < 0.05);
        }
        let none = Misfit { squared: 0.0, numbers: 0.0 };
        assert_eq!(trust(&[none]), [1.0]);
    }
}
