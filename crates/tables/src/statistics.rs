//! Summary statistics of lists of numbers.

/// Ratio of the sd to the median absolute value, for a normal distribution with mean 0.
pub const SD_FROM_MEDIAN: f64 = 1.4826;

/// Returns the quantile of `values` for a probability `q` from 0 to 1, or NaN if there are no values.
///
/// The quantile is linear between order statistics (type 7 of Hyndman & Fan 1996).
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted_quantile(&sorted, q)
}

/// Returns the quantile of sorted values for a probability `q`, or NaN if there are no values.
pub(crate) fn sorted_quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let rank = q * last as f64;
    let (below, share) = (rank.floor() as usize, rank.fract());
    let (a, b) = (sorted[below], sorted[(below + 1).min(last)]);
    // Equal neighbours are not interpolated, because the difference of two infinite values is NaN.
    if share > 0.0 && b > a { a + (b - a) * share } else { a }
}

/// Returns the median, or NaN if there are no values.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    roadplane_base::median(&mut values.to_vec()).unwrap_or(f64::NAN)
}

/// Returns the mean, or NaN if there are no values.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the share of values at or below a limit, 0 to 1. The result is NaN if there are no values.
#[must_use]
pub fn share_within(values: &[f64], limit: f64) -> f64 {
    values.iter().filter(|value| **value <= limit).count() as f64 / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_follow_the_definition() {
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
