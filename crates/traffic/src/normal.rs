//! The normal distribution.

/// Returns the probability that a standard normal number is below `z`.
///
/// Source: Abramowitz and Stegun, *Handbook of Mathematical Functions*, 7.1.26. The absolute error is below 1.5e-7.
#[must_use]
pub fn below(z: f64) -> f64 {
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let polynomial = ((((1.061_405_429 * t - 1.453_152_027) * t + 1.421_413_741) * t - 0.284_496_736) * t
        + 0.254_829_592)
        * t;
    let tail = polynomial * (-x * x).exp() / 2.0;
    if z < 0.0 { tail } else { 1.0 - tail }
}

/// Returns the probability that a quantity with mean `value` and the given sd is positive. Without an sd (0), the
/// result is 0 or 1.
#[must_use]
pub fn positive(value: f64, sd: f64) -> f64 {
    if sd > 0.0 { below(value / sd) } else { f64::from(u8::from(value > 0.0)) }
}

/// Number of sds on either side of the mean that hold 95 % of a normal distribution.
pub const SDS_95: f64 = 1.959_964;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_the_tables() {
        for (z, p) in [(0.0, 0.5), (1.0, 0.841_344_7), (-1.959_964, 0.025), (3.0, 0.998_650_1)] {
            assert!((below(z) - p).abs() < 2e-7, "{z}");
        }
        assert_eq!((positive(1.0, 0.0), positive(-1.0, 0.0)), (1.0, 0.0));
    }
}
