//! Command `roadplane distance`: computes the distance between two cars of a finished run. The sd of the distance takes
//! into account that both cars share the errors of the camera.

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::{RowVector4, Vector2};
use roadplane_base::{CameraEstimate, GroundPart, TrackRow};
use roadplane_write::{read_camera, read_jsonl};

use crate::PipelineError;
use crate::tracks::shared_error::{by_camera, shared_covariance};

/// Distance between two cars at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Presentation time of the frame, s.
    pub time_s: f64,
    /// Distance between the origins of the cars, m.
    pub distance_m: f64,
    /// Sd of the distance, m. Camera errors that shift both cars equally are not part of this sd.
    pub sd_m: f64,
}

/// Returns the distance between two tracks in every frame in which both tracks have a row. With `at_s`, a time in s,
/// only the frame nearest to that time is returned.
///
/// # Errors
/// Returns [`PipelineError::Usage`] if a track does not exist or no frame has rows of both tracks, or
/// [`PipelineError::Write`] if a file cannot be read.
pub fn distances(run: &Path, tracks: [u64; 2], at_s: Option<f64>) -> Result<Vec<Distance>, PipelineError> {
    let cameras: Vec<CameraEstimate> =
        read_camera(&run.join("camera.json"))?.all().iter().map(|segment| segment.estimate()).collect();
    let (mut first, mut second, mut numbers) = (Vec::new(), Vec::new(), BTreeSet::new());
    for row in read_jsonl::<TrackRow>(&run.join("tracks.jsonl"))? {
        let row = row?;
        numbers.insert(row.track);
        match row.track {
            track if track == tracks[0] => first.push(row),
            track if track == tracks[1] => second.push(row),
            _ => {}
        }
    }
    let missing: BTreeSet<u64> = tracks.into_iter().filter(|track| !numbers.contains(track)).collect();
    if !missing.is_empty() {
        let (noun, verb) = if missing.len() == 1 { ("track", "does") } else { ("tracks", "do") };
        let has = if numbers.is_empty() {
            "the run has no tracks".to_owned()
        } else {
            format!("the tracks of the run are {}", intervals(&numbers))
        };
        let what = format!("{noun} {} {verb} not exist; {has}: {}", intervals(&missing), run.display());
        return Err(PipelineError::usage(&what));
    }
    let mut found: Vec<Distance> = first
        .iter()
        .filter_map(|a| {
            let b = second.binary_search_by_key(&a.frame, |row| row.frame).ok().map(|i| &second[i])?;
            (a.segment == b.segment).then(|| between(cameras.get(a.segment)?, a, b)).flatten()
        })
        .collect();
    if let Some(at_s) = at_s {
        let away = |d: &Distance| (d.time_s - at_s).abs();
        let nearest = found.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
        found = nearest.into_iter().collect();
    }
    if found.is_empty() {
        let what = format!("tracks {} and {} have no frame in common", tracks[0], tracks[1]);
        return Err(PipelineError::usage(&what));
    }
    Ok(found)
}

/// Returns numbers as text, with consecutive numbers as intervals: `1–3, 7`.
fn intervals(numbers: &BTreeSet<u64>) -> String {
    let mut intervals: Vec<(u64, u64)> = Vec::new();
    for &number in numbers {
        match intervals.last_mut() {
            Some((_, last)) if *last + 1 == number => *last = number,
            _ => intervals.push((number, number)),
        }
    }
    let text = |(from, to): &(u64, u64)| if from == to { from.to_string() } else { format!("{from}–{to}") };
    intervals.iter().map(text).collect::<Vec<_>>().join(", ")
}

fn between(camera: &CameraEstimate, a: &TrackRow, b: &TrackRow) -> Option<Distance> {
    let position = |row: &TrackRow| Vector2::new(row.x_m, row.y_m);
    let difference = position(b) - position(a);
    let direction = difference.try_normalize(1e-9)?;
    // The car's own variance is the variance in the row minus the variance that the camera causes.
    let own = |row: &TrackRow| {
        let shared = shared_covariance(camera, &row.pose());
        let variance = |sd: f64, i: usize| (sd * sd - shared[(i, i)]).max(0.0);
        direction.x.powi(2) * variance(row.x_sd_m, 0) + direction.y.powi(2) * variance(row.y_sd_m, 1)
    };
    let along = |row: &TrackRow| -> Option<RowVector4<f64>> {
        Some(direction.transpose() * by_camera(camera, &row.pose())?.fixed_rows::<2>(0))
    };
    let ground = camera.ground();
    let [part_a, part_b] = [a, b].map(|row| ground.part_at(row.x_m, row.y_m));
    let variance =
        |by: RowVector4<f64>, part: &GroundPart| (by * camera.above(part).covariance * by.transpose())[0];
    // On one plane, most of the shared error cancels. The errors of two planes count as independent.
    let shared = match part_a.index == part_b.index {
        true => variance(along(b)? - along(a)?, &part_a),
        false => variance(along(a)?, &part_a) + variance(along(b)?, &part_b),
    };
    let sd_m = (own(a) + own(b) + shared).sqrt();
    let distance_m = difference.norm().hypot(b.z_m - a.z_m);
    Some(Distance { time_s: a.time_s, distance_m, sd_m })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracks::shared_error::tests::estimate;
    use roadplane_base::GroundPose;
    use roadplane_write::JsonLines;

    #[test]
    fn a_track_that_does_not_exist_is_named_with_those_that_do() {
        let run = tempfile::tempdir().unwrap();
        let camera = estimate([0.01; 4]);
        roadplane_write::write_camera(&run.path().join("camera.json"), &[camera], Vec::new()).unwrap();
        let mut rows = JsonLines::create(&run.path().join("tracks.jsonl")).unwrap();
        for track in [1, 2, 3, 7] {
            rows.write(&roadplane_synth::stationary_row(track, 0, 0.0)).unwrap();
        }
        rows.finish().unwrap();
        let message = |tracks| distances(run.path(), tracks, None).unwrap_err().to_string();
        assert!(message([2, 9]).starts_with("track 9 does not exist; the tracks of the run are 1–3, 7: "));
        assert!(message([9, 8]).starts_with("tracks 8–9 do not exist; "));
        assert!(message([9, 9]).starts_with("track 9 does not exist; "));
    }

    #[test]
    fn the_distance_of_neighbouring_cars_has_their_own_errors_and_that_of_scale() {
        let camera = estimate([0.03, 0.01, 0.01, 0.04]);
        let row = |x_m: f64| {
            let pose = GroundPose { x_m, y_m: 40.0, heading_rad: 1.5 };
            let shared = shared_covariance(&camera, &pose);
            TrackRow {
                x_m,
                y_m: 40.0,
                heading_rad: 1.5,
                x_sd_m: (0.01 + shared[(0, 0)]).sqrt(),
                y_sd_m: (0.01 + shared[(1, 1)]).sqrt(),
                ..roadplane_synth::stationary_row(1, 0, 0.0)
            }
        };
        let near = between(&camera, &row(1.0), &row(3.0)).unwrap();
        assert!((near.distance_m - 2.0).abs() < 1e-12);
        // The sd of each position is more than a metre. The sd of the distance comes only from the cars' own errors and
        // from a small scale error.
        assert!(row(1.0).y_sd_m > 1.0 && (0.14..0.25).contains(&near.sd_m), "{near:?}");
    }
}
