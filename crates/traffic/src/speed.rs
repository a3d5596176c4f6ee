//! Means and percentiles of speeds, with their sds.
//!
//! The sd of a figure says how well the speeds are measured. It has two parts: the errors of the vehicles themselves,
//! which average out, and the error of the metric scale, which all vehicles share. It does not say how well a few
//! vehicles represent the traffic of other days.

/// A measured speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// Speed, m/s.
    pub mps: f64,
    /// Sd without the error that all vehicles share, m/s; 0 if unknown.
    pub own_sd_mps: f64,
    /// Relative sd of the metric scale at the place of the measurement; 0 if unknown.
    pub scale_sd: f64,
}

/// A figure with its sd.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured {
    /// Value of the figure.
    pub value: f64,
    /// Sd of the figure.
    pub sd: f64,
}

/// Returns the mean of speeds over vehicles (time-mean speed); `None` without speeds.
#[must_use]
pub fn time_mean(speeds: &[Speed]) -> Option<Measured> {
    let n = speeds.len() as f64;
    let mean = |f: &dyn Fn(&Speed) -> f64| speeds.iter().map(f).sum::<f64>() / n;
    let own = mean(&|s| s.own_sd_mps.powi(2)) / n;
    let shared = mean(&|s| s.mps * s.scale_sd);
    (!speeds.is_empty()).then(|| Measured { value: mean(&|s| s.mps), sd: own.sqrt().hypot(shared) })
}

/// Returns the space-mean speed: the harmonic mean of the speeds at a line (Wardrop 1952). `None` if there is no speed, or
/// a speed is not positive.
#[must_use]
pub fn space_mean(speeds: &[Speed]) -> Option<Measured> {
    if speeds.is_empty() || speeds.iter().any(|s| s.mps <= 0.0) {
        return None;
    }
    let n = speeds.len() as f64;
    let value = n / speeds.iter().map(|s| 1.0 / s.mps).sum::<f64>();
    let slope = |s: &Speed| (value / s.mps).powi(2) / n;
    let own: f64 = speeds.iter().map(|s| (slope(s) * s.own_sd_mps).powi(2)).sum();
    let shared: f64 = speeds.iter().map(|s| slope(s) * s.mps * s.scale_sd).sum();
    Some(Measured { value, sd: own.sqrt().hypot(shared) })
}

/// Returns the speed below which the given share of the vehicles drive, such as V85 for 0.85. Between two vehicles, the
/// speed is interpolated (Hyndman and Fan 1996, definition 7). `None` without speeds.
#[must_use]
pub fn percentile(speeds: &[Speed], share: f64) -> Option<Measured> {
    let mut sorted = speeds.to_vec();
    sorted.sort_by(|a, b| a.mps.total_cmp(&b.mps));
    let place = share * (sorted.len().checked_sub(1)?) as f64;
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    let value = sorted[low].mps + (sorted[high].mps - sorted[low].mps) * (place - place.floor());
    // The vehicles near the percentile decide together where it lies. Their weights are those of a normal kernel whose
    // width is the error of a single vehicle.
    let width = (sorted[low].own_sd_mps + sorted[high].own_sd_mps) / 2.0;
    let near = |s: &Speed| if width > 0.0 { (-((s.mps - value) / width).powi(2) / 2.0).exp() } else { 1.0 };
    let weights: Vec<f64> = sorted.iter().map(near).collect();
    let sum: f64 = weights.iter().sum();
    let own: f64 = sorted.iter().zip(&weights).map(|(s, w)| (w / sum.max(1.0) * s.own_sd_mps).powi(2)).sum();
    let shared = value.abs() * sorted.iter().zip(&weights).map(|(s, w)| w * s.scale_sd).sum::<f64>()
        / sum.max(f64::MIN_POSITIVE);
    Some(Measured { value, sd: own.sqrt().hypot(shared) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speeds(values: &[f64], own_sd_mps: f64, scale_sd: f64) -> Vec<Speed> {
        values.iter().map(|&mps| Speed { mps, own_sd_mps, scale_sd }).collect()
    }

    #[test]
    fn means_and_percentiles_of_four_speeds() {
        let four = speeds(&[20.0, 10.0, 40.0, 30.0], 0.0, 0.0);
        assert_eq!(time_mean(&four).unwrap().value, 25.0);
        assert!((space_mean(&four).unwrap().value - 19.2).abs() < 1e-12);
        assert_eq!(percentile(&four, 0.5).unwrap().value, 25.0);
        assert!((percentile(&four, 0.85).unwrap().value - 35.5).abs() < 1e-12);
        assert_eq!((time_mean(&[]), space_mean(&[]), percentile(&[], 0.5)), (None, None, None));
        assert_eq!(space_mean(&speeds(&[10.0, -1.0], 0.0, 0.0)), None);
    }

    #[test]
    fn own_errors_average_out_and_the_scale_does_not() {
        let many = speeds(&[10.0; 100], 0.5, 0.0);
        for figure in [time_mean(&many), space_mean(&many), percentile(&many, 0.85)] {
            assert!((figure.unwrap().sd - 0.05).abs() < 1e-9, "{figure:?}");
        }
        let scaled = speeds(&[10.0; 100], 0.0, 0.03);
        for figure in [time_mean(&scaled), space_mean(&scaled), percentile(&scaled, 0.85)] {
            assert!((figure.unwrap().sd - 0.3).abs() < 1e-9, "{figure:?}");
        }
    }

    /// Simulates measured speeds, and compares the errors of V85 with the claimed sds.
    #[test]
    fn the_sd_of_a_percentile_is_that_of_its_errors() {
        let mut seed = 12_345_u64;
        let mut uniform = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let (mut squares, rounds) = (0.0, 400);
        for _ in 0..rounds {
            let truth: Vec<f64> = (0..60).map(|_| 14.0 + 2.0 * normal()).collect();
            let scale = 1.0 + 0.02 * normal();
            let measured: Vec<Speed> = truth
                .iter()
                .map(|v| Speed { mps: (v + 0.4 * normal()) * scale, own_sd_mps: 0.4, scale_sd: 0.02 })
                .collect();
            let exact = percentile(&speeds(&truth, 0.0, 0.0), 0.85).unwrap().value;
            let found = percentile(&measured, 0.85).unwrap();
            squares += ((found.value - exact) / found.sd).powi(2);
        }
        let ratio = (squares / f64::from(rounds)).sqrt();
        assert!((0.8..1.25).contains(&ratio), "{ratio}");
    }
}
