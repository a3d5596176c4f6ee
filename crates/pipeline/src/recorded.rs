//! The time at which a clip was recorded: from its name, from its container, or from the clock of its file.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use roadplane_decode::creation_time;
use roadplane_write::{civil_time, time_in_name};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::stem_of;

/// The time at which a clip was recorded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Recorded {
    /// Time at which the input was recorded, such as `2026-01-31T22:00:00`. It is UTC, or as in the input's name.
    #[serde(rename = "recorded")]
    pub time: String,
    /// Origin of that time.
    #[serde(rename = "recorded_from")]
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

/// Returns a time as civil time, UTC.
fn time_in_words(time: SystemTime) -> String {
    civil_time(time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs().cast_signed())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

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
}
