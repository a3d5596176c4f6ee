//! Computes the activities of tracks, for the rows of a run or for a separate file of tracks.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roadplane_activity::{ActivityNet, Event, Motion};
use roadplane_base::TrackRow;
use roadplane_write::{JsonLines, TableFormat, TableRow, WriteError, read_table, write_table};
use serde_json::Value;

use crate::stream::nets::open_activity;
use crate::tracks::TimeChunk;
use crate::{Cancel, Config, PipelineError};

/// Greatest sd of a row's own position, m. The net was trained on such sds.
///
/// The sds of a table without own sds may contain the camera's part, metres for distant vehicles. That part moves a
/// whole track and changes nothing along it. The tracker's own error is rarely larger than this.
const OWN_SD_M: f64 = 1.0;

/// Limits an sd (m) to [`OWN_SD_M`].
fn own_at_most(sd_m: f64) -> f64 {
    sd_m.min(OWN_SD_M)
}

/// Returns the motion of a track from its rows, which are ordered by time.
#[must_use]
pub fn track_motion<'a>(rows: impl Iterator<Item = &'a TrackRow> + Clone) -> Motion {
    let rows = || rows.clone();
    Motion {
        time_s: rows().map(|row| row.time_s).collect(),
        xy_m: rows().map(|row| [row.x_m, row.y_m]).collect(),
        heading_rad: rows().map(|row| row.heading_rad).collect(),
        sd_m: rows()
            .map(|row| [(row.x_own_sd_m, row.x_sd_m), (row.y_own_sd_m, row.y_sd_m)])
            .map(|sds| sds.map(|(own, whole)| own.unwrap_or(own_at_most(whole))))
            .collect(),
        seen: rows().map(|row| row.observed).collect(),
    }
}

/// Fills in `activity` and `activity_p` of all rows. Returns the events.
pub(crate) fn label_rows(net: &mut ActivityNet, rows: &mut [TrackRow]) -> Result<Vec<Event>, PipelineError> {
    let mut events = Vec::new();
    let numbers: Vec<u64> = rows.iter().map(|row| row.track).collect();
    for (track, places) in by_track(numbers) {
        let labelled = net.label(&track_motion(places.iter().map(|place| &rows[*place])))?;
        for (place, (label, p)) in places.iter().zip(&labelled.samples) {
            rows[*place].activity = Some(label.name().to_owned());
            rows[*place].activity_p = Some(*p);
        }
        events.extend(labelled.events(track));
    }
    Ok(events)
}

/// Adds the events of a time chunk, cut to the chunk's own time. An event that continues over the chunk's beginning
/// stays one event.
pub(crate) fn add_events(events: &mut Vec<Event>, found: Vec<Event>, chunk: TimeChunk) {
    let duration_s = |event: &Event| event.to_s - event.from_s;
    for event in found {
        let own = Event { from_s: event.from_s.max(chunk.from_s), to_s: event.to_s.min(chunk.to_s), ..event };
        if own.from_s > own.to_s || (own.from_s == own.to_s && own.to_s == chunk.to_s) {
            continue;
        }
        let goes_on = |before: &&mut Event| {
            (before.track, before.activity, before.to_s) == (own.track, own.activity, chunk.from_s)
        };
        let before = if own.from_s == chunk.from_s { events.iter_mut().find(goes_on) } else { None };
        match before {
            Some(before) => {
                let (a, b) = (duration_s(before), duration_s(&own));
                before.confidence = (a * before.confidence + b * own.confidence) / (a + b).max(f64::EPSILON);
                before.to_s = own.to_s;
            }
            None => events.push(own),
        }
    }
}

/// Returns the indices of each track's rows, in their order.
fn by_track<T: Ord>(tracks: impl IntoIterator<Item = T>) -> BTreeMap<T, Vec<usize>> {
    let mut places: BTreeMap<T, Vec<usize>> = BTreeMap::new();
    for (place, track) in tracks.into_iter().enumerate() {
        places.entry(track).or_default().push(place);
    }
    places
}

/// Writes `activities.jsonl`, ordered by beginning, then by track. Times are rounded to the millisecond.
pub(crate) fn write_events(path: &Path, mut events: Vec<Event>) -> Result<(), PipelineError> {
    events.sort_by(|a, b| a.from_s.total_cmp(&b.from_s).then(a.track.cmp(&b.track)));
    let rounded = |value: f64| (value * 1e3).round() / 1e3;
    let mut lines = JsonLines::create(path)?;
    for event in events {
        let (from_s, to_s) = (rounded(event.from_s), rounded(event.to_s));
        lines.write(&Event { from_s, to_s, confidence: rounded(event.confidence), ..event })?;
    }
    Ok(lines.finish()?)
}

/// Adds `activity` and `activity_p` to the rows of a table of tracks, and writes the events beside it.
///
/// The table needs `time_s`, `track`, `x_m` and `y_m`. The columns `heading_rad`, `x_sd_m`, `y_sd_m`, `x_own_sd_m`,
/// `y_own_sd_m` and `observed` are used where present. The events go to `OUT` with the extension `.activities.jsonl`.
/// Returns the number of events.
///
/// # Errors
/// [`PipelineError`]. The events are written after the table, so an error may leave the table alone.
pub fn activity_file(
    tracks: &Path,
    out: &Path,
    models: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<usize, PipelineError> {
    TableFormat::of(out).map_err(|error| PipelineError::usage(&error.to_string()))?;
    let mut rows = read_table(tracks)?;
    let mut net = open_activity(models, config)?;
    let bad = |place: usize, what: String| {
        PipelineError::from(WriteError::malformed(tracks, format!("row {}: {what}", place + 1)))
    };
    let mut numbers = Vec::with_capacity(rows.len());
    for (place, row) in rows.iter().enumerate() {
        let track = row.get("track").and_then(Value::as_u64);
        numbers.push(track.ok_or_else(|| bad(place, "track is missing or no whole number".to_owned()))?);
    }
    let mut events = Vec::new();
    for (track, mut places) in by_track(numbers) {
        if let Some(signal) = cancel.signal() {
            return Err(PipelineError::Stopped { signal });
        }
        let mut samples = Vec::with_capacity(places.len());
        for place in &places {
            samples.push(Sample::of(&rows[*place]).map_err(|what| bad(*place, what))?);
        }
        let mut order: Vec<usize> = (0..places.len()).collect();
        order.sort_by(|a, b| samples[*a].time_s.total_cmp(&samples[*b].time_s));
        places = order.iter().map(|i| places[*i]).collect();
        let samples: Vec<Sample> = order.iter().map(|i| samples[*i]).collect();
        let labelled = net.label(&motion(&samples))?;
        for (place, (label, p)) in places.iter().zip(&labelled.samples) {
            rows[*place].insert("activity".to_owned(), label.name().into());
            rows[*place].insert("activity_p".to_owned(), ((p * 1e4).round() / 1e4).into());
        }
        events.extend(labelled.events(track));
    }
    let count = events.len();
    write_table(out, &rows)?;
    write_events(&events_beside(out), events)?;
    Ok(count)
}

/// Returns the path of the file of activity events beside the table of tracks `out`.
fn events_beside(out: &Path) -> PathBuf {
    out.with_extension("activities.jsonl")
}

/// A row of a table of tracks.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Time, s.
    time_s: f64,
    /// Position on the ground, m.
    xy_m: [f64; 2],
    /// Heading, rad, if given.
    heading_rad: Option<f64>,
    /// Sds of the position, m, if given.
    sd_m: Option<[f64; 2]>,
    /// Whether the vehicle was detected at this time.
    seen: bool,
}

impl Sample {
    /// Reads a row; an error in words if a value is missing or out of range.
    fn of(row: &TableRow) -> Result<Self, String> {
        let given = |name: &str| match row.get(name) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => match value.as_f64().filter(|number| number.is_finite()) {
                Some(number) => Ok(Some(number)),
                None => Err(format!("{name} is no finite number")),
            },
        };
        let needed = |name: &str| given(name)?.ok_or_else(|| format!("{name} is missing"));
        let given_sd = |name: &str| match given(name)? {
            Some(sd) if sd < 0.0 => Err(format!("{name} is negative")),
            sd => Ok(sd),
        };
        let sd = |whole: &str, own: &str| -> Result<Option<f64>, String> {
            let whole = given_sd(whole)?;
            Ok(given_sd(own)?.or(whole.map(own_at_most)))
        };
        Ok(Self {
            time_s: needed("time_s")?,
            xy_m: [needed("x_m")?, needed("y_m")?],
            heading_rad: given("heading_rad")?,
            sd_m: sd("x_sd_m", "x_own_sd_m")?.zip(sd("y_sd_m", "y_own_sd_m")?).map(|(x, y)| [x, y]),
            seen: match row.get("observed") {
                None | Some(Value::Null) => true,
                Some(value) => (value.as_bool().or(value.as_i64().map(|number| number != 0)))
                    .ok_or("observed is neither true nor false")?,
            },
        })
    }
}

/// Returns the motion of a track. Headings and sds are used only where all of its rows have them.
fn motion(samples: &[Sample]) -> Motion {
    let all = |there: fn(&Sample) -> bool| samples.iter().all(there);
    let (headings, sds) = (all(|s| s.heading_rad.is_some()), all(|s| s.sd_m.is_some()));
    Motion {
        time_s: samples.iter().map(|s| s.time_s).collect(),
        xy_m: samples.iter().map(|s| s.xy_m).collect(),
        heading_rad: samples.iter().filter_map(|s| s.heading_rad.filter(|_| headings)).collect(),
        sd_m: samples.iter().filter_map(|s| s.sd_m.filter(|_| sds)).collect(),
        seen: samples.iter().map(|s| s.seen).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a table of one vehicle: stationary at 60 m, it starts after 5 s and drives away from the camera.
    fn table(along_sd_m: f64) -> String {
        let mut table = "time_s,track,x_m,y_m,x_sd_m,y_sd_m\n".to_owned();
        for i in 0..120 {
            let time_s = f64::from(i) / 10.0;
            let y_m = 60.0 + 0.6 * (time_s - 5.0).max(0.0).powi(2);
            table += &format!("{time_s},1,0.0,{y_m},0.3,{along_sd_m}\n");
        }
        table
    }

    #[test]
    fn how_far_off_the_camera_is_hides_no_start() {
        if roadplane_infer::find_library(None).is_err() {
            eprintln!("skipped: the ONNX runtime is not found");
            return;
        }
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let folder = tempfile::tempdir().unwrap();
        let labels = |along_sd_m: f64| -> Vec<String> {
            let (tracks, out) = (folder.path().join("tracks.csv"), folder.path().join("out.csv"));
            std::fs::write(&tracks, table(along_sd_m)).unwrap();
            activity_file(&tracks, &out, &models, &Config::default(), &Cancel::default()).unwrap();
            let label = |row: &TableRow| row["activity"].as_str().unwrap_or_default().to_owned();
            read_table(&out).unwrap().iter().map(label).collect()
        };
        let near = labels(1.0);
        assert_eq!(near[20], "not_moving");
        assert_eq!(near[70], "starting");
        assert_eq!(labels(12.0), near);
    }
}
