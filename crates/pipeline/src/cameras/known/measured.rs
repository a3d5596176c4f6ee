//! Parses numbers as a user writes them: `1500`, `1500±60`, `1500+-60`, `1500±4%`.

use std::str::FromStr;

/// Sd of a height that is given without one, as a share of the height.
pub(crate) const GUESSED_HEIGHT_SHARE: f64 = 0.05;
/// Sd of a tilt or roll that is given without one, °.
pub(crate) const GUESSED_TILT_SD_DEG: f64 = 2.0;

/// A number with an optional sd.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The number.
    pub value: f64,
    /// Its sd in the same unit, above 0.
    pub sd: Option<f64>,
}

impl FromStr for Measured {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let split = ["±", "+-", "+/-"].iter().find_map(|sign| text.split_once(sign));
        let (value, sd) = split.map_or((text, None), |(value, sd)| (value, Some(sd.trim())));
        let number = |text: &str| {
            let number = text.trim().parse().ok().filter(|v: &f64| v.is_finite());
            number.ok_or_else(|| {
                format!("{:?} is no number; write for example 1500, 1500±60 or 1500±4%", text.trim())
            })
        };
        let value = number(value)?;
        let sd = match sd.map(|sd| (sd, sd.strip_suffix('%'))) {
            None => None,
            Some((_, Some(percent))) => Some(number(percent)? / 100.0 * value.abs()),
            Some((sd, None)) => Some(number(sd)?),
        };
        match sd {
            Some(sd) if sd.is_nan() || sd <= 0.0 => Err("the sd after ± must be above 0".to_owned()),
            sd => Ok(Self { value, sd }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_with_their_sd_or_without() {
        let read = |text: &str| text.parse::<Measured>().map(|m| (m.value, m.sd));
        assert_eq!(read("1500"), Ok((1500.0, None)));
        for text in ["1500±60", "1500+-60", "1500 +/- 60", " 1500 ± 4% "] {
            assert_eq!(read(text), Ok((1500.0, Some(60.0))), "{text}");
        }
        assert_eq!(read("-2±0.5"), Ok((-2.0, Some(0.5))));
        assert_eq!(read("-20±5%"), Ok((-20.0, Some(1.0))));
        for (text, words) in [
            ("", "no number"),
            ("wide", "\"wide\" is no number"),
            ("inf", "no number"),
            ("1500±", "no number"),
            ("1500±0", "above 0"),
            ("1500±-3", "above 0"),
            ("0±4%", "above 0"),
            ("1500±x%", "no number"),
        ] {
            assert!(read(text).unwrap_err().contains(words), "{text}");
        }
    }
}
