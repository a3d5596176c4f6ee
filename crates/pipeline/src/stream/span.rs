//! A piece of an input: an interval that starts and ends at full minutes.

use std::fmt;
use std::str::FromStr;

use roadplane_decode::DecodeOptions;
use roadplane_watch::RENEW_S;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::stream::cadence::RESET_S;

/// Time by which decoding of a piece starts before the watcher needs frames, s. With this margin, the piece has the
/// same inference frames as a run over the whole input.
const MARGIN_S: f64 = 2.0;
/// Pieces start and end at multiples of this time, s.
pub(crate) const STEP_S: u64 = RESET_S as u64;

/// An interval of an input that starts at a full minute. It ends at a full minute or at the end of the input. It is
/// written as `FROM-TO` or `FROM-`, in seconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub struct Span {
    /// Start of the interval, s of the input.
    pub from_s: u64,
    /// End of the interval, s of the input. `None` for the end of the input.
    pub to_s: Option<u64>,
}

impl Span {
    /// Returns the options that decode this interval and the time before it that the watcher needs. `all` are the
    /// options for the whole input.
    pub(crate) fn options(&self, all: &DecodeOptions) -> DecodeOptions {
        let watched_s = self.from_s as f64 - RENEW_S - MARGIN_S;
        let to_s = self.to_s.map_or(f64::INFINITY, |to_s| to_s as f64);
        let end_s = all.end_s.unwrap_or(f64::INFINITY).min(to_s);
        DecodeOptions {
            start_s: all.start_s.max(watched_s),
            end_s: end_s.is_finite().then_some(end_s),
            ..all.clone()
        }
    }

    /// Returns the folder name for this piece of an input. `stem` is the name of the input's result.
    pub(crate) fn folder(&self, stem: &str) -> String {
        format!("{stem}.piece-{:06}", self.from_s)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-", self.from_s)?;
        self.to_s.map_or(Ok(()), |to_s| write!(f, "{to_s}"))
    }
}

impl From<Span> for String {
    fn from(span: Span) -> Self {
        span.to_string()
    }
}

impl TryFrom<String> for Span {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl FromStr for Span {
    type Err = String;

    /// Parses a text such as `600-1200` or `3000-`.
    fn from_str(text: &str) -> Result<Self, String> {
        let seconds = |part: &str| part.parse::<u64>().ok().filter(|second| second.is_multiple_of(STEP_S));
        let span = text.split_once('-').and_then(|(from, to)| {
            let to_s = if to.is_empty() { None } else { Some(seconds(to)?) };
            Some(Self { from_s: seconds(from)?, to_s })
        });
        span.filter(|span| span.to_s.is_none_or(|to_s| to_s > span.from_s)).ok_or_else(|| {
            format!("{text:?} is no piece: write FROM-TO or FROM-, in multiples of {STEP_S} s")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_written_as_they_are_read_and_start_at_full_minutes() {
        for text in ["0-60", "600-1200", "3000-"] {
            assert_eq!(text.parse::<Span>().unwrap().to_string(), text);
        }
        for text in ["", "-", "60", "0-59", "1-60", "120-60", "60-60", "-60", "a-b"] {
            assert!(text.parse::<Span>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_piece_is_watched_early_enough_and_stays_within_the_options() {
        let all = DecodeOptions { start_s: 50.0, end_s: Some(130.0), ..DecodeOptions::default() };
        let of = |text: &str| {
            let options = text.parse::<Span>().unwrap().options(&all);
            (options.start_s, options.end_s)
        };
        assert_eq!(of("0-60"), (50.0, Some(60.0)));
        assert_eq!(of("120-"), (98.0, Some(130.0)));
    }
}
