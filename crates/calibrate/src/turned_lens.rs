//! Lens distortion from the turns of a camera.
//!
//! Two pictures of a camera that turns or zooms differ by a homography of their undistorted pixels, whatever the focal
//! length (Fitzgibbon, CVPR 2001). The watcher fits the homography and the distortion together. Here the distortions of
//! all pictures are combined.

use std::collections::BTreeMap;

use roadplane_base::Registration;

/// Largest number of pictures of a reference that count as independent. The error of the reference itself is in all of
/// them. With 10, the errors of the focal lengths of 30 rendered pans have an rms of one sd; 8 is a little more cautious.
pub(crate) const INDEPENDENT: f64 = 8.0;

/// Mean and sd of the distortion that the turns of the camera show, without unit ([`roadplane_base::Lens::distortion`]).
pub type TurnedLens = [f64; 2];

/// Weighted sums over measurements of the distortion.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f64,
    weight: f64,
    first: f64,
    second: f64,
}

impl Sums {
    fn add(&mut self, distortion: f64, weight: f64) {
        self.count += 1.0;
        self.weight += weight;
        self.first += weight * distortion;
        self.second += weight * distortion * distortion;
    }

    fn mean(&self) -> f64 {
        self.first / self.weight
    }

    /// Returns the factor on the variance that the scatter demands (Birge 1932); at least 1.
    fn excess(&self) -> f64 {
        let scatter = self.second - self.first * self.first / self.weight;
        if self.count > 1.0 { (scatter / (self.count - 1.0)).max(1.0) } else { 1.0 }
    }
}

/// Combines the distortions that the pictures of a clip show. Its memory grows with the number of references alone.
#[derive(Clone, Debug, Default)]
pub struct TurnedLensBuilder {
    references: BTreeMap<u64, Sums>,
}

impl TurnedLensBuilder {
    /// Takes the most accurate registration of the next picture.
    pub fn push(&mut self, registration: &Registration) {
        if let Some(lens) = registration.lens.filter(|lens| lens.sd > 0.0) {
            self.references.entry(registration.reference).or_default().add(lens.bend, lens.sd.powi(-2));
        }
    }

    /// Returns the distortion; `None` if no picture was displaced.
    #[must_use]
    pub fn finish(&self) -> Option<TurnedLens> {
        let mut all = Sums::default();
        for sums in self.references.values() {
            let share = (INDEPENDENT / sums.count).min(1.0);
            all.add(sums.mean(), share * sums.weight / sums.excess());
        }
        let sd = (all.excess() / all.weight).sqrt();
        (all.count > 0.0 && sd.is_finite()).then(|| [all.mean(), sd])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::RegisteredLens;

    fn registration(reference: u64, distortion: f64, sd: f64) -> Registration {
        let lens = Some(RegisteredLens { bend: distortion, sd, change: [0.0; 8] });
        Registration { reference, homography: None, sd_px: 0.1, lens }
    }

    #[test]
    fn pictures_of_one_reference_are_not_independent() {
        let mut builder = TurnedLensBuilder::default();
        assert_eq!(builder.finish(), None);
        (0..100).for_each(|_| builder.push(&registration(0, -0.03, 0.002)));
        let [distortion, sd] = builder.finish().unwrap();
        assert!((distortion + 0.03).abs() < 1e-12 && (sd - 0.002 / INDEPENDENT.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn references_that_contradict_each_other_widen_the_sd() {
        let mut builder = TurnedLensBuilder::default();
        builder.push(&registration(0, -0.03, 0.002));
        builder.push(&registration(40, 0.01, 0.002));
        let [distortion, sd] = builder.finish().unwrap();
        assert!((distortion + 0.01).abs() < 1e-12 && sd > 0.015, "{distortion} ± {sd}");
    }
}
