//! How much looks tell that follow one another.

/// Looks nearer than this to the one before tell nothing new, s: what the detector misses or takes for a vehicle, it does again.
const APART_S: f64 = 0.075;

/// Counts looks that are far enough apart.
#[derive(Clone, Copy, Debug, Default)]
pub struct Looks {
    /// How many there were.
    pub count: usize,
    last_s: Option<f64>,
}

impl Looks {
    /// Counts looks at these times (s), in order.
    #[must_use]
    pub fn of(times_s: impl IntoIterator<Item = f64>) -> Self {
        let mut looks = Self::default();
        for time_s in times_s {
            looks.add(time_s);
        }
        looks
    }

    /// The next look, at this time (s); whether it counts.
    pub fn add(&mut self, time_s: f64) -> bool {
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
