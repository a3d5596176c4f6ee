//! ActEV: input files for the scorer of the NIST evaluation "Activities in Extended Video".
//!
//! The files are the system output and the two index files that the scorer needs. Frames are numbered from 1.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::TrackRow;
use roadplane_write::{WriteError, write_json};
use serde_json::{Map, Value, json};

use crate::{Event, Run, Track};

/// Returns the name of an activity in MEVA and ActEV. An activity without such a name keeps its own name, with
/// `vehicle_` in front.
pub fn activity_name(ours: &str) -> String {
    let theirs = match ours {
        "turning_left" => "turns_left",
        "turning_right" => "turns_right",
        "u_turn" => "makes_u_turn",
        "starting" => "starts",
        "stopping" => "stops",
        "reversing" => "reverses",
        other => other,
    };
    format!("vehicle_{theirs}")
}

/// Returns the reason why a run cannot be written for the scorer; `None` if it can be written.
pub fn lacks(run: &Run) -> Option<String> {
    run.events.is_none().then(|| "needs activities, and the run has none (no activities.jsonl)".to_owned())
}

/// Writes the system output, the file index and the activity index.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let events = run.events.as_deref().unwrap_or_default();
    let tracks: BTreeMap<u64, &Track> = run.tracks.iter().map(|track| (track.id, track)).collect();
    let activities: Vec<Value> = events
        .iter()
        .enumerate()
        .filter_map(|(i, event)| Some(instance(run, i + 1, event, tracks.get(&event.track)?)))
        .collect();
    let media = &run.media;
    let output = json!({
        "filesProcessed": [media],
        "activities": activities,
        "processingReport": {"fileStatuses": {media: {"status": "success", "message": ""}}},
    });
    write_json(&folder.join(format!("{}.json", run.name)), &output)?;
    let selected = signal(1, run.frames.max(1));
    let files = json!({media: {"framerate": (run.frames_per_s * 1e3).round() / 1e3, "selected": selected}});
    write_json(&folder.join("file-index.json"), &files)?;
    let kinds: BTreeMap<String, Value> =
        events.iter().map(|event| (activity_name(&event.activity), json!({}))).collect();
    write_json(&folder.join("activity-index.json"), &kinds)
}

/// Returns a signal that is 1 from frame `first` to frame `last`, and 0 after frame `last`.
fn signal(first: u64, last: u64) -> Value {
    json!({first.to_string(): 1, (last + 1).to_string(): 0})
}

fn instance(run: &Run, id: usize, event: &Event, track: &Track) -> Value {
    let (begin, end) = (run.frame_at(event.from_s), run.frame_at(event.to_s));
    let during: Vec<&TrackRow> =
        track.rows.iter().filter(|row| (begin..=end.max(begin)).contains(&row.frame)).collect();
    let media = &run.media;
    json!({
        "activity": activity_name(&event.activity),
        "activityID": id,
        "presenceConf": event.confidence,
        "alertFrame": end + 1,
        "localization": {media: signal(begin + 1, end.max(begin) + 1)},
        "objects": [{
            "objectType": "Vehicle",
            "objectID": track.id,
            "localization": {media: boxes(&during, end + 1)},
        }],
    })
}

/// Returns the boxes by frame number. A box is valid until the next frame in the list. The last entry is an empty box
/// in the frame after the last row.
fn boxes(rows: &[&TrackRow], last: u64) -> Value {
    let mut boxes = Map::new();
    for row in rows {
        let [x0, y0, x1, y1] = row.bbox_px.map(|v| v.round() as i64);
        let bbox = json!({"x": x0, "y": y0, "w": x1 - x0, "h": y1 - y0});
        boxes.insert((row.frame + 1).to_string(), json!({"presenceConf": row.score, "boundingBox": bbox}));
    }
    boxes.insert((rows.last().map_or(last, |row| row.frame + 1) + 1).to_string(), json!({}));
    Value::Object(boxes)
}
