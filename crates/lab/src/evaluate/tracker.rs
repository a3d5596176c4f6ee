//! Scores the tracker alone, on simulated boxes and keypoints of clips with truth.
//!
//! The simulated errors are those of the detector and the keypoint net under bad conditions. No video is needed. The
//! frames that a run recorded can take the place of simulated ones.

mod claims;
mod layers;
mod noise;

use std::collections::BTreeSet;
use std::path::PathBuf;

use roadplane_base::ShapeAtlas;
use roadplane_pipeline::{CameraConstraints, Cancel, Config, PipelineError, Progress};
use roadplane_tables::Report;
use roadplane_track::TrackStep;
use roadplane_write::OutFile;

use claims::{Claim, claims_csv, existence_claims, join_claims, reliability_table};
use layers::{VARIANTS, layers_table};
pub use noise::Noise;

use crate::LabError;
use crate::parallel::try_in_parallel;
use crate::systems::{solve_fused, solve_recorded};
use crate::tables::{calibration_table, motion_table, position_table, tracking_table};
use crate::work::{of_simulated_keypoints, stopped};
use crate::workplace::Workplace;
use roadplane_metrics::scoring::{TrackScore, score_tracks};
use roadplane_metrics::truth::{Kind, Truth, read_dataset, read_truth, scene_name};

/// Options of the evaluation of the tracker.
#[derive(Clone, Debug)]
pub struct TrackerOptions {
    /// Folder of runs. The frames of a clip are those of `FOLDER/CLIP/frames.jsonl`, and none are simulated.
    pub recorded: Option<PathBuf>,
    /// Whether the clips are tracked with each step left out, too.
    pub layers: bool,
    /// CSV file for all tracks, with the features of existence.
    pub candidates: Option<PathBuf>,
    /// CSV file for all joins over gaps, with the features of their probability.
    pub joins: Option<PathBuf>,
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
    let clips = read_clips(clips)?;
    let title = "Tracks from noisy measurements".to_owned();
    if options.layers {
        progress.expect(Some((clips.len() * VARIANTS.len()) as u64));
        let mut scores = Vec::new();
        for (_, without) in VARIANTS {
            let mut config = config.clone();
            config.track.without = without;
            let scored = score_clips(&clips, options, &config, cancel, progress)?;
            scores.push(scored.into_iter().map(|scored| scored.score).collect());
        }
        return Ok(Report { title, tables: vec![layers_table(&scores)], ..Report::default() });
    }
    progress.expect(Some(clips.len() as u64));
    // The probability of a join is fitted to all joins, also to those that it cuts.
    let mut config = config.clone();
    config.track.without = options.joins.is_some().then_some(TrackStep::Cut);
    let scored = score_clips(&clips, options, &config, cancel, progress)?;
    let (mut scores, mut existence, mut joins) = (Vec::new(), Vec::new(), Vec::new());
    for scored in scored {
        scores.push(scored.score);
        existence.push(scored.existence);
        joins.push(scored.joins);
    }
    for (path, claims) in [(&options.candidates, &existence), (&options.joins, &joins)] {
        let Some(path) = path else { continue };
        let of_clips = clips.iter().zip(claims).map(|((name, _), claims)| (name.as_str(), claims.as_slice()));
        let mut file = OutFile::create(path)?;
        file.write_bytes(claims_csv(of_clips).as_bytes())?;
        file.finish()?;
    }
    let mut systems: Vec<(&str, &[TrackScore])> =
        clips.iter().zip(scores.chunks(1)).map(|((name, _), score)| (name.as_str(), score)).collect();
    if scores.len() > 1 {
        systems.push(("all", &scores));
    }
    let positions: Vec<Vec<_>> = scores.iter().map(|score| score.positions.clone()).collect();
    let mut tracks = tracking_table("Tracks on the ground", &systems);
    tracks.note += &match &options.recorded {
        Some(runs) => format!(" Frames recorded in {}.", runs.display()),
        None => format!(" Measurements: {}.", options.noise),
    };
    let all = [("all", scores.as_slice())];
    let tables = vec![
        tracks,
        position_table("Position", &[("all", &positions)]),
        calibration_table("Position against its sd", &all),
        motion_table("Motion", &all),
        reliability_table(
            "Probability that a track is a vehicle",
            "tracks",
            "A track is a vehicle if most of its observed rows show one (IoU from 0.35 on). Only reported tracks count; \
             track.min_exists_p=0 reports all.",
            &existence.concat(),
        ),
        reliability_table(
            "Probability that a join over a gap is right",
            "joins",
            "A join is right if the rows within a second of the gap mostly show the same vehicle (IoU from 0.35 on).",
            &joins.concat(),
        ),
    ];
    Ok(Report { title, tables, ..Report::default() })
}

/// The result of one clip.
struct Scored {
    /// Score of the tracks.
    score: TrackScore,
    /// Which tracks are vehicles.
    existence: Vec<Claim>,
    /// Which joins over gaps are right.
    joins: Vec<Claim>,
}

/// Solves, tracks and scores all clips.
fn score_clips(
    clips: &[(String, Truth)],
    options: &TrackerOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Vec<Scored>, LabError> {
    let atlas = ShapeAtlas::shipped().map_err(PipelineError::from)?;
    let score = |(): &mut (), i: usize| -> Result<Scored, LabError> {
        stopped(cancel)?;
        let (name, truth) = &clips[i];
        let workplace = Workplace::new(None)?;
        let (constraints, folder) = (CameraConstraints::default(), workplace.folder());
        let (clip, processed) = if let Some(runs) = &options.recorded {
            let frames = runs.join(name).join("frames.jsonl");
            (solve_recorded(&atlas, &frames, &constraints, folder, config, cancel)?, None)
        } else {
            let seed = options.seed.wrapping_mul(1_000_003).wrapping_add(i as u64);
            let frames = options.noise.measure(truth, options.stride, seed);
            let processed: BTreeSet<u64> = frames.iter().map(|frame| frame.frame).collect();
            let config = of_simulated_keypoints(config);
            (solve_fused(&atlas, &frames, &constraints, folder, &config, cancel)?, Some(processed))
        };
        progress.frame_done();
        let is_processed = |frame: u64, _: f64| processed.as_ref().is_none_or(|all| all.contains(&frame));
        Ok(Scored {
            score: score_tracks(truth, &clip.rows, is_processed),
            existence: existence_claims(truth, &clip),
            joins: join_claims(truth, &clip),
        })
    };
    try_in_parallel(clips.len(), || Ok(()), score)
}

/// Reads the name and the truth of every clip. Stills are left out.
fn read_clips(paths: &[PathBuf]) -> Result<Vec<(String, Truth)>, LabError> {
    let mut clips = Vec::new();
    for path in paths {
        let items = if path.is_dir() { read_dataset(path)?.items } else { vec![path.clone()] };
        for item in items {
            let truth = read_truth(&item)?;
            if truth.kind == Kind::Clip {
                clips.push((scene_name(&item), truth));
            }
        }
    }
    if clips.is_empty() {
        return Err(LabError::unsuitable("there is no clip among the truth files"));
    }
    Ok(clips)
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_metrics::{clear::Clear, hota::HotaCounts, identity::Identity};
    use std::path::Path;

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
