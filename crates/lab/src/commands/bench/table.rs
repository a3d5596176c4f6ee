//! The output of `roadplane-lab bench`: a table, or the same numbers as JSON.

use std::io::Write as _;

use roadplane_pipeline::DecodeCost;
use roadplane_tables::{Cell, Column, Table};
use serde_json::{Value, json};

use super::measured::{Measured, over_decoding, rest_share};

/// The note that explains the table.
const NOTE: &str = "CPU: user and system time of all threads over frames read. The time of a stage is \
    that of its thread.\nDecode includes the decoder's own threads. Detect and keypoints include their nets. Rest of \
    perception: watch,\nregion-of-interest scheduling, crops, resampling, records.";

/// Prints the costs as a table.
pub fn print(input: &str, runs: &[Measured], decoding: &DecodeCost) -> std::io::Result<()> {
    let mut columns = vec![Column::new("", 0)];
    columns.extend(runs.iter().map(|run| Column::new(run.name, 0)));
    columns.push(Column::new("decoding alone", 0));
    let mut table = Table::new(format!("Cost of a run on {input}"), NOTE, columns);
    for (title, of, alone) in rows() {
        let mut row = vec![Cell::from(title)];
        row.extend(runs.iter().map(|run| Cell::from(of(run, decoding))));
        row.push(Cell::from(alone(decoding)));
        table.rows.push(row);
    }
    std::io::stdout().lock().write_all(table.to_text().as_bytes())
}

type OfRun = fn(&Measured, &DecodeCost) -> String;
type OfDecoding = fn(&DecodeCost) -> String;

/// Returns the table's rows. A row has a title and two functions: value of a run, and value of decoding alone.
fn rows() -> Vec<(&'static str, OfRun, OfDecoding)> {
    let none: OfDecoding = |_| String::new();
    vec![
        ("frames", |run, _| run.speed.frames.to_string(), |decoding| decoding.frames.to_string()),
        (
            "frames/s",
            |run, _| format!("{:.1}", run.speed.frames_per_s()),
            |decoding| format!("{:.1}", decoding.frames_per_s()),
        ),
        ("times real time", |run, _| format!("{:.2}", run.speed.times_real_time()), none),
        (
            "CPU ms a frame",
            |run, _| ms(run.speed.cpu_ms_per_frame.total),
            |decoding| ms(decoding.cpu_ms_per_frame()),
        ),
        ("  open (hash, nets)", |run, _| ms(run.speed.cpu_ms_per_frame.open), none),
        (
            "  decode",
            |run, _| ms(run.speed.cpu_ms_per_frame.decode),
            |decoding| ms(decoding.cpu_ms_per_frame()),
        ),
        ("  watch", |run, _| ms(run.speed.cpu_ms_per_frame.watch), none),
        ("  detect", |run, _| ms(run.speed.cpu_ms_per_frame.detect), none),
        ("    its net", |run, _| ms(run.speed.cpu_ms_per_frame.detect_net), none),
        ("  keypoints", |run, _| ms(run.speed.cpu_ms_per_frame.keypoints), none),
        ("    their net", |run, _| ms(run.speed.cpu_ms_per_frame.keypoints_net), none),
        ("  spool", |run, _| ms(run.speed.cpu_ms_per_frame.spool), none),
        ("  solve", |run, _| ms(run.speed.cpu_ms_per_frame.solve), none),
        ("  write, report", |run, _| ms(run.speed.cpu_ms_per_frame.write), none),
        ("times decoding alone", |run, decoding| format!("{:.2}", over_decoding(run, decoding)), none),
        ("perception beyond decode and nets, %", |run, _| percent(rest_share(run)), none),
        ("picture processed by the detector, % a frame", |run, _| percent(run.speed.seen_share), none),
        ("inference frames a second", |run, _| format!("{:.2}", run.speed.inference_frames_per_s()), none),
        ("keypoint crops", |run, _| run.speed.crops.to_string(), none),
        ("keypoint crops a frame", |run, _| format!("{:.3}", run.speed.crops_per_frame()), none),
        (
            "cores busy",
            |run, _| format!("{:.2}", run.speed.cores_busy),
            |decoding| format!("{:.2}", decoding.cpu_s / decoding.wall_s.max(1e-9)),
        ),
        (
            "peak memory, MiB",
            |run, _| {
                run.peak_memory_bytes
                    .map_or(String::new(), |bytes| format!("{:.0}", bytes as f64 / 1_048_576.0))
            },
            none,
        ),
    ]
}

fn ms(value: f64) -> String {
    format!("{value:.2}")
}

fn percent(share: f64) -> String {
    format!("{:.2}", 100.0 * share)
}

/// Prints the costs as one JSON object.
pub fn print_json(input: &str, runs: &[Measured], decoding: &DecodeCost) -> anyhow::Result<()> {
    let of_run = |run: &Measured| -> anyhow::Result<Value> {
        Ok(json!({
            "name": run.name,
            "frames_per_s": run.speed.frames_per_s(),
            "times_real_time": run.speed.times_real_time(),
            "times_decoding_alone": over_decoding(run, decoding),
            "left_half_rest_share": rest_share(run),
            "looks_per_s": run.speed.inference_frames_per_s(),
            "crops_per_frame": run.speed.crops_per_frame(),
            "peak_memory_bytes": run.peak_memory_bytes,
            "speed": serde_json::to_value(&run.speed)?,
        }))
    };
    let runs = runs.iter().map(of_run).collect::<anyhow::Result<Vec<_>>>()?;
    let page = json!({
        "schema": "roadplane.bench/1",
        "input": input,
        "runs": runs,
        "decoding_alone": {
            "frames": decoding.frames,
            "frames_per_s": decoding.frames_per_s(),
            "cpu_ms_per_frame": decoding.cpu_ms_per_frame(),
        },
    });
    writeln!(std::io::stdout().lock(), "{}", serde_json::to_string_pretty(&page)?)?;
    Ok(())
}
