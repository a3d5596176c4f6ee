//! Reads the tracks of a finished run and prints the median and the highest speed of each vehicle.
//!
//! `cargo run --release -p roadplane-pipeline --example track_speeds -- RUN/tracks.jsonl`

use std::collections::BTreeMap;
use std::error::Error;
use std::path::PathBuf;

use roadplane_base::TrackRow;
use roadplane_write::read_jsonl;

fn main() -> Result<(), Box<dyn Error>> {
    let path = PathBuf::from(std::env::args().nth(1).ok_or("usage: track_speeds RUN/tracks.jsonl")?);
    let mut tracks: BTreeMap<u64, Vec<TrackRow>> = BTreeMap::new();
    for row in read_jsonl::<TrackRow>(&path)? {
        let row = row?;
        // Rows that are interpolated between observations have no measurement of their own.
        if row.observed {
            tracks.entry(row.track).or_default().push(row);
        }
    }
    println!("track  class   rows  median km/h  highest km/h");
    for (track, rows) in &tracks {
        // Speeds are negative when a vehicle reverses.
        let mut speeds_mps: Vec<f64> = rows.iter().map(|row| row.speed_mps.abs()).collect();
        speeds_mps.sort_by(f64::total_cmp);
        let (median, highest) = (speeds_mps[speeds_mps.len() / 2], speeds_mps[speeds_mps.len() - 1]);
        let class = format!("{:?}", rows[0].class).to_lowercase();
        println!("{track:5}  {class:6}  {:4}  {:11.1}  {:12.1}", rows.len(), 3.6 * median, 3.6 * highest);
    }
    Ok(())
}
