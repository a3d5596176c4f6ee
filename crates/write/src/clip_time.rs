//! Times of recording: from file names, as text and as seconds since 1970.

use std::sync::LazyLock;

use jiff::Timestamp;
use jiff::civil::{Date, DateTime, Time};
use jiff::tz::TimeZone;
use regex::Regex;

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

/// Returns the date and time in the name of a clip, in a notation such as `20260131T235959`, `2026-01-31_23-59`, or
/// `20260131`. `None` if the name has no date.
#[must_use]
pub fn start_in_name(name: &str) -> Option<DateTime> {
    NOTATIONS.iter().find_map(|notation| {
        let found = notation.captures(name)?;
        let parts: Vec<i16> =
            found.iter().skip(1).flatten().filter_map(|m| m.as_str().parse().ok()).collect();
        let part = |i: usize| i8::try_from(parts.get(i).copied().unwrap_or(0)).ok();
        let date = Date::new(*parts.first()?, part(1)?, part(2)?).ok()?;
        let time = Time::new(part(3)?, part(4)?, part(5)?, 0).ok()?;
        Some(DateTime::from_parts(date, time))
    })
}

/// Returns the date and time in the name of a clip as text, such as `2026-01-31T22:00:00`; `None` if the name has no date.
#[must_use]
pub fn time_in_name(name: &str) -> Option<String> {
    start_in_name(name).map(|time| time.to_string())
}

/// Returns a time as text, UTC, such as `2026-01-31T23:59:59`. `seconds` counts from the start of 1970. A time that the
/// calendar does not cover becomes the start of 1970.
#[must_use]
pub fn civil_time(seconds: i64) -> String {
    TimeZone::UTC.to_datetime(Timestamp::from_second(seconds).unwrap_or_default()).to_string()
}

/// Returns the number of seconds from the start of 1970 to a time such as `2026-01-31T23:59:59`, UTC; `None` if the text
/// has another form.
#[must_use]
pub fn seconds_since_1970(civil_time: &str) -> Option<i64> {
    let time: DateTime = civil_time.parse().ok()?;
    Some(TimeZone::UTC.to_timestamp(time).ok()?.as_second())
}

#[cfg(test)]
mod tests {
    use super::*;

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
            ("2018-03-07.11-05-07.11-10-07.school.G330", Some("2018-03-07T11:05:07")),
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
    fn civil_times_are_converted_both_ways() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00"),
            (-1, "1969-12-31T23:59:59"),
            (951_782_400 + 86_399, "2000-02-29T23:59:59"),
            (1_769_903_999, "2026-01-31T23:59:59"),
        ] {
            assert_eq!(civil_time(seconds), text);
            assert_eq!(seconds_since_1970(text), Some(seconds));
        }
        assert_eq!(seconds_since_1970("2026-13-01T00:00:00"), None);
    }
}
