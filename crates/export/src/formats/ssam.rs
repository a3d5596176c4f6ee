//! SSAM, the Surrogate Safety Assessment Model of the US Federal Highway Administration: a binary trajectory file.
//!
//! The layout is that of "SSAM File Format v1.04" (Siemens ITS, 2004). Every version of SSAM reads it. The file has one
//! `FORMAT` record and one `DIMENSIONS` record. Then each frame has a `TIMESTEP` record and a `VEHICLE` record for each
//! of its rows.
//!
//! Units are metres and seconds, in single precision. Coordinates are those of the run's world frame: x to the right of
//! the camera, y away from it. A run contains no lanes, so the link and the lane of every vehicle are 0. SSAM then
//! classifies conflicts by their angle.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector2;
use roadplane_base::TrackRow;
use roadplane_write::{OutFile, WriteError};

use super::files::by_frame;
use crate::{Run, RunSegment, Track};

const FORMAT: u8 = 0;
const DIMENSIONS: u8 = 1;
const TIMESTEP: u8 = 2;
const VEHICLE: u8 = 3;

/// The file has little-endian numbers.
const LITTLE_ENDIAN: u8 = b'L';
const VERSION: f32 = 1.04;
/// The units are metres and metres per second.
const METRIC: u8 = 1;
/// Metres per unit of x and y.
const SCALE: f32 = 1.0;

/// Writes one file per segment, because each segment has its own world frame.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    for segment in &run.segments {
        let mut file = OutFile::create(&folder.join(format!("{}.trj", segment.name)))?;
        file.write_bytes(&[FORMAT, LITTLE_ENDIAN])?;
        file.write_bytes(&VERSION.to_le_bytes())?;
        file.write_bytes(&[DIMENSIONS, METRIC])?;
        file.write_bytes(&SCALE.to_le_bytes())?;
        for edge in edges_m(run, segment) {
            file.write_bytes(&edge.to_le_bytes())?;
        }
        let accelerations = accelerations_mps2(run);
        for (frame, rows) in by_frame(run, segment) {
            let time_s = rows.first().map_or(0.0, |(_, row)| row.time_s);
            file.write_bytes(&[TIMESTEP])?;
            file.write_bytes(&single(time_s))?;
            for (track, row) in rows {
                let number = i32::try_from(track.id).map_err(|_out_of_range| too_large(run, track))?;
                let acceleration = accelerations.get(&(track.id, frame)).copied().unwrap_or(0.0);
                file.write_bytes(&vehicle(number, track, row, acceleration))?;
            }
        }
        file.finish()?;
    }
    Ok(())
}

/// Returns the acceleration in each row by track number and frame, m/s².
fn accelerations_mps2(run: &Run) -> BTreeMap<(u64, u64), f64> {
    let of_track = |track: &Track| {
        let frames: Vec<(u64, u64)> = track.rows.iter().map(|row| (track.id, row.frame)).collect();
        frames.into_iter().zip(track.accelerations())
    };
    run.tracks.iter().flat_map(of_track).collect()
}

fn single(value: f64) -> [u8; 4] {
    (value as f32).to_le_bytes()
}

fn too_large(run: &Run, track: &Track) -> WriteError {
    let what = format!("the format ssam has 32-bit vehicle numbers, and the run has a track {}", track.id);
    WriteError::malformed(&run.folder, what)
}

/// Returns the record of a vehicle: number, link, lane, front bumper, rear bumper, length, width, speed, acceleration.
fn vehicle(number: i32, track: &Track, row: &TrackRow, acceleration_mps2: f64) -> Vec<u8> {
    let (front, rear) = (track.front(row), track.rear(row));
    let lengths_and_speeds =
        [front.x, front.y, rear.x, rear.y, row.length_m, row.width_m, row.speed_mps, acceleration_mps2];
    let mut record = vec![VEHICLE];
    record.extend(number.to_le_bytes());
    record.extend(0i32.to_le_bytes());
    record.push(0);
    record.extend(lengths_and_speeds.into_iter().flat_map(single));
    record
}

/// Returns the edges of a rectangle that contains all vehicles of the segment: smallest x and y, largest x and y, m.
fn edges_m(run: &Run, segment: &RunSegment) -> [i32; 4] {
    let corners = run.rows().into_iter().filter(|(_, row)| segment.contains(row));
    let corners = corners.flat_map(|(track, row)| [track.front(row), track.rear(row)]);
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    for corner in corners {
        (low, high) = (low.inf(&corner), high.sup(&corner));
    }
    // A conversion to `i32` clamps. An empty segment gets a small rectangle, because SSAM rejects an empty one.
    if low.x > high.x {
        return [-1, -1, 1, 1];
    }
    [low.x - 1.0, low.y - 1.0, high.x + 2.0, high.y + 2.0].map(|edge| edge.floor() as i32)
}
