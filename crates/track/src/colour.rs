//! The colour of a vehicle: do two boxes show the same one?
//!
//! The difference of two mean colours has a part that all channels share (light), and the rest (tint). Let q be its
//! squared length in sds. For one vehicle and for two vehicles, the differences have a t distribution ([`SCATTER`]). The
//! sds of two vehicles are larger by the factor r. So the log likelihood ratio is
//!
//! ```text
//! 3 log r − cost(q) + cost(q / r²)
//! ```
//!
//! It lies between −4 log r and 3 log r. `scripts/train/tracks` fits r and the sds to rendered clips with truth;
//! `models/tracks.json` has them.

use nalgebra::Vector3;

use crate::{filter::MOTION_S, measurement::Observation, numbers::NUMBERS, vehicle::SCATTER};

/// A mean colour: red, green, blue, 0–255.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Colour(Vector3<f64>);

impl Colour {
    /// Returns the colour of a detection; `None` where none was measured.
    pub(crate) fn of(seen: &Observation) -> Option<Self> {
        Some(Self(Vector3::from(seen.detection.colour_rgb?.map(f64::from))))
    }

    /// Returns the mean colour of detections; `None` where none of them has one.
    pub(crate) fn mean<'a>(all: impl Iterator<Item = &'a Observation>) -> Option<Self> {
        let all: Vec<Vector3<f64>> = all.filter_map(Self::of).map(|Self(colour)| colour).collect();
        (!all.is_empty()).then(|| Self(all.iter().sum::<Vector3<f64>>() / all.len() as f64))
    }

    /// Follows the colour of a vehicle that is detected again after `gap_s`. It changes as fast as motion does.
    pub(crate) fn follow(&mut self, Self(new): Self, gap_s: f64) {
        self.0 += (new - self.0) * (1.0 - (-gap_s / MOTION_S).exp());
    }

    /// Returns the log likelihood ratio of one vehicle against two.
    pub(crate) fn same_vehicle(self, other: Self) -> f64 {
        3.0 * ratio().ln() - self.cost(other)
    }

    /// Returns how different two colours are, 0–1: the loss of the log likelihood ratio, as a share of the largest one.
    pub(crate) fn difference(self, other: Self) -> f64 {
        self.cost(other) / (7.0 * ratio().ln())
    }

    /// Returns the loss of the log likelihood ratio, relative to equal colours.
    fn cost(self, other: Self) -> f64 {
        let [light_sd, tint_sd, _] = NUMBERS.colour;
        let change = other.0 - self.0;
        let light = change.mean();
        let squared = (light / light_sd).powi(2) + change.add_scalar(-light).norm_squared() / tint_sd.powi(2);
        SCATTER.cost(squared) - SCATTER.cost(squared / ratio().powi(2))
    }
}

/// Returns the ratio of the sds of two vehicles and of one.
fn ratio() -> f64 {
    NUMBERS.colour[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tint_says_more_than_the_light() {
        let grey = Colour(Vector3::repeat(100.0));
        let (darker, red) = (Colour(Vector3::repeat(80.0)), Colour(Vector3::new(120.0, 90.0, 90.0)));
        let far = Colour(Vector3::new(1e9, 0.0, 0.0));
        assert!(grey.same_vehicle(grey) > 0.0 && grey.same_vehicle(darker) > grey.same_vehicle(red));
        assert!(grey.same_vehicle(red) < 0.0);
        assert!(grey.difference(grey).abs() < 1e-9 && (grey.difference(far) - 1.0).abs() < 1e-6);
        assert!((grey.same_vehicle(far) + 4.0 * ratio().ln()).abs() < 1e-6, "the limit of the description");
    }
}
