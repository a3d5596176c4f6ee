//! Times of recording: from file names, as text and as seconds since 1970.

use jiff::Timestamp;
use jiff::civil::{Date, DateTime, Time};
use jiff::tz::TimeZone;
use regex::Regex;

/// Returns the date and time in the name of a clip, such as `gate-3_20260131_2200.mp4`. Seconds, or the whole time of
/// day, may be missing. `None` if the name has no date.
#[must_use]
pub fn start_in_name(name: &str) -> Option<DateTime> {
    let form = Regex::new(
        r"(?:^|\D)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)(?:[-_.T ]+(\d\d)[-_.:h]?(\d\d)(?:[-_.:m]?(\d\d))?|(\d\d)(\d\d)(\d\d))?(?:\D|$)",
    );
    let found = form.ok()?.captures(name)?;
    let number = |i: usize| found.get(i).and_then(|text| text.as_str().parse::<i16>().ok());
    let small = |i: usize, or: usize| {
        number(i).or_else(|| number(or)).and_then(|n| i8::try_from(n).ok()).unwrap_or(0)
    };
    let date = Date::new(number(1)?, small(2, 2), small(3, 3)).ok()?;
    let time = Time::new(small(4, 7), small(5, 8), small(6, 9), 0).ok()?;
    Some(DateTime::from_parts(date, time))
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
    fn dates_in_names() {
        let start = |name: &str| start_in_name(name).map(|local| local.to_string());
        for (name, expected) in [
            ("gate-3_20260131_2200", "2026-01-31T22:00:00"),
            ("gate-3_20260131", "2026-01-31T00:00:00"),
            ("2018-03-07.11-05-07.11-10-07.school.G330", "2018-03-07T11:05:07"),
            ("cam1_20260131221530", "2026-01-31T22:15:30"),
            ("cam 2026-01-31T22:15", "2026-01-31T22:15:00"),
        ] {
            assert_eq!(start(name).as_deref(), Some(expected), "{name}");
        }
        for name in ["lot", "VIRAT_S_000002", "cam_20261331_2200", "20260131991500"] {
            assert_eq!(start(name), None, "{name}");
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
