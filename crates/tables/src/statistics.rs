//! Numbers that say what many numbers are like.

/// Robust sd of a normal distribution in units of its median absolute value.
pub const SD_FROM_MEDIAN: f64 = 1.4826;

/// Quantile `q` in 0–1, linear between order statistics (type 7 of Hyndman & Fan 1996); NaN of nothing.
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted_quantile(&sorted, q)
}

/// The same of values in order.
pub(crate) fn sorted_quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = q * last as f64;
    let (below, share) = (place.floor() as usize, place.fract());
    let (a, b) = (sorted[below], sorted[(below + 1).min(last)]);
    // Infinite neighbours have no difference.
    if share > 0.0 && b > a { a + (b - a) * share } else { a }
}

/// Median; NaN of nothing.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    roadplane_base::median(&mut values.to_vec()).unwrap_or(f64::NAN)
}

/// Mean; NaN of nothing.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Share of values at or below a limit, 0–1; NaN of nothing.
#[must_use]
pub fn share_within(values: &[f64], limit: f64) -> f64 {
    values.iter().filter(|value| **value <= limit).count() as f64 / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_definition() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&values), 2.5);
        assert!((quantile(&values, 0.9) - 3.7).abs() < 1e-12);
        assert_eq!(quantile(&values, 0.0), 1.0);
        assert!(median(&[]).is_nan());
        assert_eq!(median(&[1.0, f64::INFINITY, 2.0]), 2.0);
        assert_eq!(quantile(&[1.0, f64::INFINITY, f64::INFINITY], 0.9), f64::INFINITY);
        assert_eq!(share_within(&[0.1, 0.2, f64::INFINITY, 0.2], 0.2), 0.75);
    }
}
