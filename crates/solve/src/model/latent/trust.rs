//! Trust: the weight of each car in the camera's equations.
//!
//! The atlas describes most cars well and a few badly. A car unlike the atlas still fits some car of another size, or
//! from another height, and a few of them can turn the camera. They can be recognised, because they fit worse than the
//! frame's other cars. So keypoints and shape of a car are Student-t distributed as one vector: normal, with a variance
//! factor per car. By iterative reweighting (Lange, Little and Taylor 1989, J. Am. Stat. Assoc. 84) this becomes the
//! normal problem. The cost of a car with n measured numbers and squared distance d² is multiplied by
//!
//! ```text
//! w = (ν + n) / (ν + n q)        q = (d²/n + ε) / (min(median d²/n, 1) + ε)
//! ```
//!
//! The sds of a frame's keypoints may all be too wide. So a car is compared with the frame's median; if that is above
//! 1, all cars get less weight. Only the cars' information on the camera is weighted. The sds of a car's own pose and
//! shape, given the camera, follow from its keypoints' sds alone.

use roadplane_base::{StudentT, median};

/// ε: for fits much closer than this, differences have no effect.
const CLOSE: f64 = 0.05;

/// Quality of a car's fit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Misfit {
    /// d²: squared whitened residuals and shape coefficients, with the robust loss.
    pub squared: f64,
    /// n: number of measured numbers, two per keypoint, times the keypoint's weight.
    pub numbers: f64,
}

impl Misfit {
    /// Returns the weight w of a car whose sds are taken as they are (q = d²/n).
    pub fn weight(&self) -> f64 {
        StudentT { dimensions: self.numbers }.weight(self.squared)
    }
}

/// Returns the weight of each car.
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
