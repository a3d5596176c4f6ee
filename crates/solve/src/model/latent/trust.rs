//! Weights (the trust) of the cars in the normal equations of the camera.
//!
//! The shape atlas describes most cars well and a few cars badly. A car unlike the atlas can be fitted only with a
//! wrong size or a wrong camera height. A few such cars can turn the estimated camera. They can be recognised, because
//! they fit worse than most cars of the frame.
//!
//! So the keypoints and the shape of a car form one vector with a Student-t distribution. This is a normal distribution
//! whose variance has an unknown factor per car. Iterative reweighting (Lange, Little and Taylor 1989, J. Am. Stat.
//! Assoc. 84) reduces this to ordinary least squares. The cost of each car is multiplied by a weight w:
//!
//! ```text
//! w = (ν + n) / (ν + n q)        q = (d²/n + ε) / (min(median d²/n, 1) + ε)
//! ```
//!
//! Here n is the number of measured values of the car, and d² is its squared whitened distance from the model. The
//! distribution has ν degrees of freedom. The constant ε is `CLOSE`.
//!
//! The keypoint sds of a frame may all be too large, so a car is compared with the frame's median. If the median
//! exceeds 1, all cars get less weight. The weights affect only the cars' information on the camera. For a fixed
//! camera, the sds of a car's pose and shape follow from its keypoint sds alone.

use roadplane_base::{StudentT, median};

/// The constant ε of the weights. Differences between fits whose d²/n is much smaller than this have no effect.
const CLOSE: f64 = 0.05;

/// Misfit of one car: how far its keypoints and shape are from the model.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Misfit {
    /// Squared distance d²: the weighted robust losses of the keypoints, plus the squared distance from the shape
    /// prior.
    pub squared: f64,
    /// Number n of measured values: the sum of the keypoints' weights, times two.
    pub numbers: f64,
}

impl Misfit {
    /// Returns the car's weight from its own misfit alone, on the assumption that its keypoint sds are correct.
    ///
    /// In the formula at the top of this file, q is then d²/n.
    pub fn weight(&self) -> f64 {
        StudentT { dimensions: self.numbers }.weight(self.squared)
    }
}

/// Returns the weight w of each car of a frame.
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
    fn a_car_that_fits_like_the_others_has_weight_one() {
        for level in [4.0, 20.0, 40.0] {
            for weight in trust(&cars(&[level; 5])) {
                assert!((weight - 1.0).abs() < 1e-12);
            }
        }
        assert!(trust(&[]).is_empty());
    }

    #[test]
    fn a_car_that_fits_worse_has_less_weight() {
        let weights = trust(&cars(&[8.0, 10.0, 40.0, 12.0, 10.0]));
        assert!(weights[2] < 0.35 && weights[0] > 1.0 && weights[0] > weights[3]);
    }

    #[test]
    fn a_frame_that_fits_badly_has_less_weight() {
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
