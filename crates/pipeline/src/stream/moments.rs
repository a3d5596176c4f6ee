//! A collection of items that are spread over time and limited in bytes.

/// Keeps the first item of each time slot. When the items need too many bytes, the slots become twice as long.
///
/// Slots start at multiples of their length, counted from the start of the input. When two slots merge, the long slot
/// and the earlier short slot start at the same time and have the same first item. The kept items are therefore the
/// same wherever streaming started and whenever the slots grew.
#[derive(Debug)]
pub(crate) struct Moments<T> {
    slot_s: f64,
    room: u64,
    level: u32,
    bytes: u64,
    /// For each kept item: the number of its slot at the first slot length, its size in bytes, and the item.
    kept: Vec<(u64, u64, T)>,
}

impl<T> Moments<T> {
    /// Creates an empty collection. Its slots are `slot_s` seconds long at first, and its items may use `room` bytes.
    pub(crate) fn new(slot_s: f64, room: u64) -> Self {
        Self { slot_s, room, level: 0, bytes: 0, kept: Vec::new() }
    }

    /// Returns the number of times that the length of the slots has doubled.
    pub(crate) fn level(&self) -> u32 {
        self.level
    }

    /// Makes the slots longer until their length has doubled at least `level` times in total.
    pub(crate) fn coarsen(&mut self, level: u32) {
        if level > self.level {
            self.level = level;
            self.thin();
        }
    }

    /// Whether an item at this time would be kept. The time must be later than the times of all kept items.
    pub(crate) fn is_due(&self, time_s: f64) -> bool {
        let slot = self.slot(time_s) >> self.level;
        self.room > 0 && self.kept.last().is_none_or(|(last, ..)| last >> self.level != slot)
    }

    /// Adds an item that needs `bytes` bytes. [`Self::is_due`] must be true for `time_s`.
    pub(crate) fn keep(&mut self, time_s: f64, bytes: u64, item: T) {
        self.kept.push((self.slot(time_s), bytes, item));
        self.bytes += bytes;
        // A single item is kept, whatever its size.
        while self.bytes > self.room && self.kept.len() > 1 {
            self.level += 1;
            self.thin();
        }
    }

    /// Returns the kept items in the order of time.
    pub(crate) fn items(&self) -> impl Iterator<Item = &T> {
        self.kept.iter().map(|(.., item)| item)
    }

    fn slot(&self, time_s: f64) -> u64 {
        // The time is rounded to milliseconds, like the times in files.
        ((time_s * 1e3).round() / (self.slot_s * 1e3)).max(0.0) as u64
    }

    fn thin(&mut self) {
        let (level, mut last) = (self.level, None);
        self.kept.retain(|(slot, ..)| last.replace(slot >> level) != Some(slot >> level));
        self.bytes = self.kept.iter().map(|(_, bytes, _)| bytes).sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_items_fit_and_are_spread_over_clips_of_any_length() {
        for length in [1_u64, 10, 1000, 100_000] {
            let mut moments = Moments::new(0.25, 640);
            for i in 0..length {
                let time_s = 0.1 * i as f64;
                if moments.is_due(time_s) {
                    moments.keep(time_s, 10, time_s);
                }
            }
            let kept: Vec<f64> = moments.items().copied().collect();
            assert!(kept.len() <= 64 && kept.len() as u64 >= (length / 3).clamp(1, 30), "{}", kept.len());
            let gaps = kept.windows(2).map(|pair| pair[1] - pair[0]);
            let slot_s = 0.25 * f64::from(1 << moments.level());
            assert!(kept[0] < 1e-9 && gaps.fold(0.0, f64::max) <= 2.0 * slot_s);
        }
        assert!(!Moments::<()>::new(0.25, 0).is_due(3.0));
    }
}
