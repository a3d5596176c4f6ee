//! Scores the tracker alone, on simulated boxes and keypoints of clips with truth.
//!
//! The simulated errors are those of the detector and the keypoint net under bad conditions. No video is needed.

mod noise;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use roadplane_base::ShapeAtlas;
use roadplane_pipeline::{CameraConstraints, Cancel, Config, PipelineError, Progress};
use roadplane_tables::Report;

pub use noise::Noise;

use crate::LabError;
use crate::parallel::try_in_parallel;
use crate::systems::solve_fused;
use crate::tables::{calibration_table, motion_table, position_table, tracking_table};
use crate::work::stopped;
use crate::workplace::Workplace;
use roadplane_metrics::scoring::{TrackScore, score_tracks};
use roadplane_metrics::truth::{Kind, Truth, read_dataset, read_truth};

/// Options of the evaluation of the tracker.
#[derive(Clone, Debug)]
pub struct TrackerOptions {
    /// The simulated errors of boxes and keypoints.
    pub noise: Noise,
    /// Every n-th frame gets simulated boxes and keypoints; this is n.
    pub stride: u32,
    /// Seed of the simulated errors. The errors also depend on the order of the clips.
    pub seed: u64,
}

/// Solves and tracks simulated measurements of clips, and scores the tracks.
///
/// `clips` are truth files, or folders with `dataset.json`.
///
/// # Errors
/// [`LabError`] if a file cannot be read, no file has the truth of a clip, or the user stops the work.
pub fn evaluate_tracker(
    clips: &[PathBuf],
    options: &TrackerOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let atlas = ShapeAtlas::shipped().map_err(PipelineError::from)?;
    let clips = read_clips(clips)?;
    progress.expect(Some(clips.len() as u64));
    let score = |(): &mut (), i: usize| -> Result<TrackScore, LabError> {
        stopped(cancel)?;
        let truth = &clips[i].1;
        let seed = options.seed.wrapping_mul(1_000_003).wrapping_add(i as u64);
        let frames = options.noise.measure(truth, options.stride, seed);
        let processed: BTreeSet<u64> = frames.iter().map(|frame| frame.frame).collect();
        let workplace = Workplace::new(None)?;
        let (constraints, folder) = (CameraConstraints::default(), workplace.folder());
        let clip = solve_fused(&atlas, &frames, &constraints, folder, config, cancel)?;
        progress.frame_done();
        Ok(score_tracks(truth, &clip.rows, |frame, _| processed.contains(&frame)))
    };
    let scores = try_in_parallel(clips.len(), || Ok(()), score)?;
    let mut systems: Vec<(&str, &[TrackScore])> =
        clips.iter().zip(scores.chunks(1)).map(|((name, _), score)| (name.as_str(), score)).collect();
    if scores.len() > 1 {
        systems.push(("all", &scores));
    }
    let positions: Vec<Vec<_>> = scores.iter().map(|score| score.positions.clone()).collect();
    let mut tracks = tracking_table("Tracks on the ground", &systems);
    tracks.note += &format!(" Measurements: {}.", options.noise);
    let all = [("all", scores.as_slice())];
    let tables = vec![
        tracks,
        position_table("Position", &[("all", &positions)]),
        calibration_table("Position against its sd", &all),
        motion_table("Motion", &all),
    ];
    Ok(Report { title: "Tracks from noisy measurements".to_owned(), tables, ..Report::default() })
}

/// Reads the name and the truth of every clip. Stills are left out.
fn read_clips(paths: &[PathBuf]) -> Result<Vec<(String, Truth)>, LabError> {
    let mut clips = Vec::new();
    for path in paths {
        let items = if path.is_dir() { read_dataset(path)?.items } else { vec![path.clone()] };
        for item in items {
            let truth = read_truth(&item)?;
            if truth.kind == Kind::Clip {
                clips.push((name(&item), truth));
            }
        }
    }
    if clips.is_empty() {
        return Err(LabError::unsuitable("there is no clip among the truth files"));
    }
    Ok(clips)
}

/// Returns the name of a clip: `clip_0000` for `clip_0000.truth.json.gz`.
fn name(truth: &Path) -> String {
    let name = truth.file_name().unwrap_or(truth.as_os_str()).to_string_lossy();
    name.split(".truth.json").next().unwrap_or(&name).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_metrics::{clear::Clear, hota::HotaCounts, identity::Identity};

    /// Tracks the vehicles of the rendered parking lot, from good and from bad measurements.
    #[test]
    fn tracks_survive_misses_false_boxes_and_wrong_labels() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/lot.truth.json");
        let truth = read_truth(&path).unwrap();
        let atlas = ShapeAtlas::shipped().unwrap();
        let score = |noise: Noise| {
            let frames = noise.measure(&truth, 1, 3);
            let folder = tempfile::tempdir().unwrap();
            let (constraints, config, cancel) =
                (CameraConstraints::default(), Config::default(), Cancel::default());
            let clip = solve_fused(&atlas, &frames, &constraints, folder.path(), &config, &cancel).unwrap();
            score_tracks(&truth, &clip.rows, |_, _| true).fitted
        };
        let exact = Noise { keypoints: 0.002, misses: 0.0, false_boxes: 0.0, flips: 0.0, swaps: 0.0 };
        for (noise, hota, idf1) in [(exact, 0.95, 0.99), (Noise::default(), 0.85, 0.95)] {
            let sequence = score(noise);
            let found = HotaCounts::of(&sequence).score().hota;
            println!("{noise}: HOTA {found:.3}, IDF1 {:.3}", Identity::of(&sequence).idf1());
            assert!(found > hota && Identity::of(&sequence).idf1() > idf1);
            assert_eq!(Clear::of(&sequence).switches, 0);
        }
    }
}
