//! The time at which a clip was recorded: from its name, from its container, or from the clock of its file.

use std::path::Path;
use std::sync::LazyLock;
use std::time::{SystemTime, UNIX_EPOCH};

use regex::Regex;
use roadplane_decode::creation_time;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::stem_of;

/// The time at which a clip was recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Time, such as `2026-01-31T22:00:00`. It is UTC, or as in the name of the clip.
    pub time: String,
    /// Origin of the time.
    pub from: RecordedFrom,
}

/// Origin of the time at which a clip was recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RecordedFrom {
    /// The name of the input has the time: date, date and minute, or date and second.
    Name,
    /// The container has the time, UTC.
    Container,
    /// The time at which the file was last changed, UTC.
    File,
}

impl RecordedFrom {
    /// Returns the origin as words for messages.
    pub(crate) fn in_words(self) -> &'static str {
        match self {
            Self::Name => "name",
            Self::Container => "container",
            Self::File => "file time",
        }
    }
}

/// Returns the time at which a clip was recorded: the time in its name, else the time in its container, else the time
/// at which its file was last changed.
#[must_use]
pub fn recorded(input: &Path) -> Recorded {
    if let Some(time) = time_in_name(&stem_of(input)) {
        return Recorded { time, from: RecordedFrom::Name };
    }
    if let Some(time) = creation_time(input) {
        return Recorded { time: time_in_words(time), from: RecordedFrom::Container };
    }
    let changed = input.metadata().and_then(|metadata| metadata.modified()).unwrap_or(UNIX_EPOCH);
    Recorded { time: time_in_words(changed), from: RecordedFrom::File }
}

/// Notations of a time in a name, the most exact one first. A date without a second must not be a part of a longer
/// number, because such numbers are common.
static NOTATIONS: LazyLock<Vec<Regex>> = LazyLock::new(|| {
    let date = r"(20\d\d)(?:(\d\d)(\d\d)|[-_.](\d\d)[-_.](\d\d))";
    let forms = [
        r"(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.T ]?(\d\d)[-_.:]?(\d\d)[-_.:]?(\d\d)".to_owned(),
        format!(r"(?:^|\D){date}[-_.T ]?(\d\d)[-_.:]?(\d\d)(?:\D|$)"),
        format!(r"(?:^|\D){date}(?:\D|$)"),
    ];
    forms.iter().filter_map(|form| Regex::new(form).ok()).collect()
});

/// Returns a time from a name, in a notation such as `20260131T235959`, `2026-01-31_23-59`, or `20260131`.
fn time_in_name(name: &str) -> Option<String> {
    NOTATIONS.iter().find_map(|notation| {
        let found = notation.captures(name)?;
        let parts: Vec<u32> =
            found.iter().skip(1).flatten().filter_map(|m| m.as_str().parse().ok()).collect();
        let mut parts = parts.into_iter().chain([0; 3]);
        let mut within =
            |range: std::ops::RangeInclusive<u32>| parts.next().filter(|part| range.contains(part));
        let (year, month, day) = (within(2000..=2099)?, within(1..=12)?, within(1..=31)?);
        let (hour, minute, second) = (within(0..=23)?, within(0..=59)?, within(0..=60)?);
        Some(format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}"))
    })
}

/// Returns the civil time of the proleptic Gregorian calendar, UTC.
///
/// The algorithm is that of H. Hinnant, "chrono-compatible low-level date algorithms".
fn time_in_words(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let (days, rest) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}", rest / 3600, rest / 60 % 60, rest % 60)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn times_are_read_from_names() {
        for (name, time) in [
            ("c_20260131T235959", Some("2026-01-31T23:59:59")),
            ("2026-01-31_23-59-59", Some("2026-01-31T23:59:59")),
            ("x20260131235959y", Some("2026-01-31T23:59:59")),
            ("gate-3_20260131_2200", Some("2026-01-31T22:00:00")),
            ("2026-01-31_22-05_gate", Some("2026-01-31T22:05:00")),
            ("gate 202601312205", Some("2026-01-31T22:05:00")),
            ("gate_20260131", Some("2026-01-31T00:00:00")),
            ("2026.01.31.gate-12", Some("2026-01-31T00:00:00")),
            // The number after the date is no time.
            ("20260131_2575", Some("2026-01-31T00:00:00")),
            ("20260131_7", Some("2026-01-31T00:00:00")),
            ("20261331235959", None),
            ("gate_20261331", None),
            ("VIRAT_S_040100", None),
            ("VIRAT_S_200101_02", None),
            ("id1202601314", None),
        ] {
            assert_eq!(time_in_name(name).as_deref(), time, "{name}");
        }
    }

    #[test]
    fn the_name_comes_before_the_clock_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let of = |name: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, "").unwrap();
            let changed = UNIX_EPOCH + Duration::from_secs(951_868_799);
            std::fs::File::options().write(true).open(&path).unwrap().set_modified(changed).unwrap();
            let Recorded { time, from } = recorded(&path);
            (time, from)
        };
        assert_eq!(of("gate_20260131_2200.mp4"), ("2026-01-31T22:00:00".to_owned(), RecordedFrom::Name));
        assert_eq!(of("gate.mp4"), ("2000-02-29T23:59:59".to_owned(), RecordedFrom::File));
    }

    #[test]
    fn times_are_civil_times() {
        let at = |seconds| time_in_words(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01T00:00:00");
        assert_eq!(at(1_769_903_999), "2026-01-31T23:59:59");
    }
}
