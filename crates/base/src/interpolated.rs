//! Linear interpolation over time.

/// Returns the value at a time (s) from pairs of time and value, in the order of time. Before the first pair and after
/// the last one, the value is constant; without pairs it is 0.
#[must_use]
pub fn interpolated(values: &[(f64, f64)], time_s: f64) -> f64 {
    let next = values.partition_point(|(at_s, _)| *at_s < time_s);
    match (values[..next].last(), values.get(next)) {
        (Some((from_s, from)), Some((to_s, to))) => from + (to - from) * (time_s - from_s) / (to_s - from_s),
        (Some((_, value)), None) | (None, Some((_, value))) => *value,
        (None, None) => 0.0,
    }
}
