//! Local time, and the periods of the tables.

use jiff::Timestamp;
use jiff::civil::{DateTime, Time};
use jiff::tz::TimeZone;

/// The periods of the tables in local time.
#[derive(Clone, Debug)]
pub struct Clock {
    zone: TimeZone,
    every_s: f64,
}

/// A fault in an option of the clock.
#[derive(Debug, thiserror::Error)]
pub enum ClockError {
    /// The time zone does not exist.
    #[error("there is no time zone {0:?}: give a name such as Europe/Berlin, America/New_York or UTC")]
    Zone(String),
    /// The length of the periods cannot be used.
    #[error("periods of {0:?}: give a length that divides a day, such as 5min, 15min, 60min or 1h")]
    Every(String),
    /// The start of a clip cannot be read.
    #[error("start {0:?}: give a local date and time, such as 2026-01-31T22:00")]
    Start(String),
}

impl Clock {
    /// Creates a clock. `zone` is the name of a time zone in the IANA database. `every` is the length of the periods: a
    /// number of minutes, or a number with the unit `s`, `min` or `h`.
    ///
    /// # Errors
    /// [`ClockError::Zone`], [`ClockError::Every`].
    pub fn new(zone: &str, every: &str) -> Result<Self, ClockError> {
        let known = TimeZone::get(zone).map_err(|_error| ClockError::Zone(zone.to_owned()))?;
        let digits = every.find(|c: char| !c.is_ascii_digit()).unwrap_or(every.len());
        let unit = match every[digits..].trim() {
            "" | "min" | "m" => 60.0,
            "s" => 1.0,
            "h" => 3600.0,
            _ => return Err(ClockError::Every(every.to_owned())),
        };
        let every_s = every[..digits].parse::<f64>().map(|n| n * unit).unwrap_or(0.0);
        if every_s < 1.0 || 86_400.0 % every_s != 0.0 {
            return Err(ClockError::Every(every.to_owned()));
        }
        Ok(Self { zone: known, every_s })
    }

    /// Returns the length of a period, s.
    #[must_use]
    pub fn every_s(&self) -> f64 {
        self.every_s
    }

    /// Returns the beginning of the period that contains a time. Both are in s since 1970-01-01 00:00 UTC. Periods begin
    /// at local midnight; a day on which the clocks change has a period more or less.
    #[must_use]
    pub fn period_of(&self, unix_s: f64) -> f64 {
        let midnight = self
            .local(unix_s)
            .and_then(|local| self.zone.to_zoned(DateTime::from_parts(local.date(), Time::midnight())).ok())
            .map_or(0.0, |midnight| midnight.timestamp().as_second() as f64);
        midnight + ((unix_s - midnight) / self.every_s).floor() * self.every_s
    }

    /// Returns a time as local date, time of day and offset from UTC, such as `2026-01-31T22:00:00+01:00`.
    #[must_use]
    pub fn label(&self, unix_s: f64) -> String {
        let moment = Timestamp::from_millisecond((unix_s * 1000.0).round() as i64).unwrap_or_default();
        let zoned = moment.to_zoned(self.zone.clone());
        let whole = zoned.subsec_nanosecond() == 0;
        zoned.strftime(if whole { "%Y-%m-%dT%H:%M:%S%:z" } else { "%Y-%m-%dT%H:%M:%S%.3f%:z" }).to_string()
    }

    /// Returns the time of a local date and time, s since 1970-01-01 00:00 UTC.
    #[must_use]
    pub fn unix_of(&self, local: DateTime) -> Option<f64> {
        self.zone.to_zoned(local).ok().map(|zoned| zoned.timestamp().as_millisecond() as f64 / 1000.0)
    }

    /// Reads a local date and time, such as `2026-01-31T22:00`, and returns it in s since 1970-01-01 00:00 UTC.
    ///
    /// # Errors
    /// [`ClockError::Start`].
    pub fn parse_start(&self, text: &str) -> Result<f64, ClockError> {
        let local = text.parse::<DateTime>().ok().and_then(|local| self.unix_of(local));
        local.ok_or_else(|| ClockError::Start(text.to_owned()))
    }

    fn local(&self, unix_s: f64) -> Option<DateTime> {
        let moment = Timestamp::from_millisecond((unix_s * 1000.0).floor() as i64).ok()?;
        Some(self.zone.to_datetime(moment))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_begin_at_local_midnight_and_survive_summer_time() {
        let clock = Clock::new("Europe/Berlin", "15min").unwrap();
        // On 2026-03-29, the clocks in Berlin go from 02:00 to 03:00.
        let before = clock.parse_start("2026-03-29T01:59").unwrap();
        assert_eq!(clock.label(clock.period_of(before)), "2026-03-29T01:45:00+01:00");
        assert_eq!(clock.label(clock.period_of(before + 60.0)), "2026-03-29T03:00:00+02:00");
        let hours = Clock::new("Asia/Kathmandu", "1h").unwrap();
        let noon = hours.parse_start("2026-05-01T12:20").unwrap();
        assert_eq!(hours.label(hours.period_of(noon)), "2026-05-01T12:00:00+05:45");
    }

    #[test]
    fn options_that_make_no_sense_are_refused() {
        assert!(matches!(Clock::new("Atlantis", "15min"), Err(ClockError::Zone(_))));
        for every in ["", "0", "7min", "-5", "1 day", "25h", "x"] {
            assert!(matches!(Clock::new("UTC", every), Err(ClockError::Every(_))), "{every}");
        }
        assert_eq!(Clock::new("UTC", "5").unwrap().every_s(), 300.0);
        assert!(Clock::new("UTC", "5").unwrap().parse_start("tonight").is_err());
    }
}
