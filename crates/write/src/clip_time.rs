//! Times of recording: from file names, as text and as seconds since 1970.

use regex::Regex;

const SECONDS_PER_DAY: i64 = 86_400;

/// Returns a time from a file's name, in any notation such as `20260131T235959` or `2026-01-31_23-59-59`; `None` if the
/// name has no time. The result has the form `2026-01-31T23:59:59`.
#[must_use]
pub fn time_in_name(name: &str) -> Option<String> {
    let form = r"(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.T ]?(\d\d)[-_.:]?(\d\d)[-_.:]?(\d\d)";
    let found = Regex::new(form).ok()?.captures(name)?;
    let part = |i: usize| found.get(i).and_then(|m| m.as_str().parse::<u32>().ok());
    let within = |i: usize, range: std::ops::RangeInclusive<u32>| part(i).filter(|v| range.contains(v));
    let (year, month, day) = (part(1)?, within(2, 1..=12)?, within(3, 1..=31)?);
    let (hour, minute, second) = (within(4, 0..=23)?, within(5, 0..=59)?, within(6, 0..=60)?);
    Some(format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}"))
}

/// Returns the civil time of the proleptic Gregorian calendar, UTC, such as `2026-01-31T23:59:59`. `seconds` counts from
/// the start of 1970.
///
/// The algorithm is that of H. Hinnant, "chrono-compatible low-level date algorithms".
#[must_use]
pub fn civil_time(seconds: i64) -> String {
    let (days, rest) = (seconds.div_euclid(SECONDS_PER_DAY) + 719_468, seconds.rem_euclid(SECONDS_PER_DAY));
    let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}", rest / 3600, rest / 60 % 60, rest % 60)
}

/// Returns the number of seconds from the start of 1970 to a civil time such as `2026-01-31T23:59:59`, UTC; `None` if
/// the text has another form.
///
/// The algorithm is that of H. Hinnant, "chrono-compatible low-level date algorithms".
#[must_use]
pub fn seconds_since_1970(civil_time: &str) -> Option<i64> {
    let found = Regex::new(r"^(\d{4})-(\d\d)-(\d\d)T(\d\d):(\d\d):(\d\d)$").ok()?.captures(civil_time)?;
    let part = |i: usize| found.get(i).and_then(|m| m.as_str().parse::<i64>().ok());
    let (month, day) = (part(2).filter(|month| (1..=12).contains(month))?, part(3)?);
    let year = part(1)? - i64::from(month <= 2);
    let (era, year_of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let shifted = if month > 2 { month - 3 } else { month + 9 };
    let day_of_year = (153 * shifted + 2) / 5 + day - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    let days = era * 146_097 + day_of_era - 719_468;
    Some(days * SECONDS_PER_DAY + part(4)? * 3600 + part(5)? * 60 + part(6)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_from_names() {
        let told = Some("2026-01-31T23:59:59".to_owned());
        for name in ["c_20260131T235959", "2026-01-31_23-59-59", "x20260131235959y"] {
            assert_eq!(time_in_name(name), told, "{name}");
        }
        assert_eq!(time_in_name("20261331235959"), None);
        assert_eq!(time_in_name("VIRAT_S_040100"), None);
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
        assert_eq!(seconds_since_1970("yesterday"), None);
    }
}
