//! Medians.

/// Median of finite numbers; `None` of none. Sorts its input.
#[must_use]
pub fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

/// Value below which half of the weight lies; `None` without positive weight. Sorts its input of (value, weight).
#[must_use]
pub fn weighted_median(values: &mut [(f64, f64)]) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = values.iter().map(|v| v.1).sum::<f64>() / 2.0;
    let mut below = 0.0;
    values
        .iter()
        .find(|(_, weight)| {
            below += weight;
            *weight > 0.0 && below >= half
        })
        .map(|v| v.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_resist_one_bad_value() {
        assert_eq!(median(&mut [3.0, 1.0, 1e9]), Some(3.0));
        assert_eq!(median(&mut [1.0, 2.0]), Some(1.5));
        assert_eq!(median(&mut []), None);
        assert_eq!(weighted_median(&mut [(5.0, 1.0), (1.0, 1.0), (9.0, 10.0)]), Some(9.0));
        assert_eq!(weighted_median(&mut [(5.0, 0.0)]), None);
    }
}
