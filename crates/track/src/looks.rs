//! Counts the observation times that carry new information.

/// Least time between two observations that both count, s. A closer one adds nothing: the detector repeats its misses
/// and false alarms.
const APART_S: f64 = 0.075;

/// A count of the observation times that are far enough apart to carry new information.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Looks {
    /// Number of observation times that are at least the least interval apart.
    pub count: usize,
    /// Last observation time that counts, s.
    last_s: Option<f64>,
}

impl Looks {
    /// Counts the observations at these times (s), which must be in order.
    pub(crate) fn of(times_s: impl IntoIterator<Item = f64>) -> Self {
        let mut looks = Self::default();
        for time_s in times_s {
            looks.add(time_s);
        }
        looks
    }

    /// Adds the next observation time (s), and returns whether it counts.
    pub(crate) fn add(&mut self, time_s: f64) -> bool {
        let counts = self.last_s.is_none_or(|last| time_s - last >= APART_S);
        if counts {
            self.count += 1;
            self.last_s = Some(time_s);
        }
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_count_about_ten_times_a_second_at_most() {
        let count = |fps: f64| Looks::of((0..(10.0 * fps) as u32).map(|i| f64::from(i) / fps)).count;
        assert_eq!((count(10.0), count(12.0), count(5.0)), (100, 120, 50));
        assert_eq!((count(30.0), count(25.0)), (100, 125));
    }
}
