//! Row 6 of the tables, our solver on whole clips: from the same keypoints as the other rows, and from the video alone.

use std::path::{Path, PathBuf};

use roadplane_base::{PoseRecord, ShapeAtlas, TrackRow};
use roadplane_pipeline::{
    CameraConstraints, Cancel, Config, Existing, Progress, RunOptions, Silent, run_input,
};

use super::evidence::SceneEvidence;
use super::items::{DatasetOptions, Item};
use crate::LabError;
use crate::finished_run::{FinishedRun, pictures};
use crate::parallel::try_in_parallel;
use crate::systems::{CameraAnswer, solve_fused};
use crate::work::stopped;
use crate::workplace::Workplace;
use roadplane_metrics::average_precision::PictureBoxes;
use roadplane_metrics::camera::CameraError;
use roadplane_metrics::scoring::{PoseScore, TrackScore, score_poses, score_tracks};
use roadplane_metrics::truth::Kind;

/// Runs the pipeline on one input and reads the result. An existing result is overwritten.
pub(super) fn run(
    input: &Path,
    workplace: &Workplace,
    options: &DatasetOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<FinishedRun, LabError> {
    let options = RunOptions { existing: Existing::Overwrite, ..RunOptions::new(options.models.clone()) };
    let report = run_input(input, workplace.folder(), &options, config, cancel, progress)?;
    FinishedRun::read(&report.folder)
}

/// The scores of a clip.
#[derive(Clone, Debug)]
pub(super) struct ClipScore {
    pub name: String,
    /// Number of cars that appear in the clip.
    pub cars: usize,
    /// Pose errors of the cars. With given keypoints, only the frames that the other systems solve are scored.
    pub poses: Vec<PoseScore>,
    /// Track scores of all processed frames.
    pub tracks: TrackScore,
    pub camera: Option<CameraError>,
    /// True and found boxes of every processed frame; empty if the true boxes were given.
    pub boxes: Vec<PictureBoxes>,
}

/// Solves a clip from given keypoints and scores the result (row 6 of the tables). Poses are scored in about `frames`
/// frames.
pub(super) fn fused(
    item: &Item,
    scene: &SceneEvidence,
    frames: usize,
    atlas: &ShapeAtlas,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipScore, LabError> {
    let folder = Workplace::new(None)?;
    let records: Vec<_> = scene.frames.iter().map(|frame| frame.record(&item.truth)).collect();
    let clip = solve_fused(atlas, &records, &CameraConstraints::default(), folder.folder(), config, cancel)?;
    let processed: Vec<u64> = records.iter().map(|record| record.frame).collect();
    let sampled: Vec<u64> = scene.sample(frames).into_iter().map(|index| processed[index]).collect();
    Ok(score(item, clip.camera, &clip.poses, &clip.rows, &processed, &sampled, atlas))
}

/// Runs the pipeline on the video of each clip, and scores the results (row 6 of the tables).
///
/// The video is the only input: our nets find the boxes and keypoints, and there are no user constraints.
pub(super) fn run_all(
    items: &[Item],
    atlas: &ShapeAtlas,
    workplace: &Workplace,
    options: &DatasetOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Vec<ClipScore>, LabError> {
    let clips: Vec<(&Item, &PathBuf)> = items
        .iter()
        .filter(|item| item.truth.kind == Kind::Clip)
        .filter_map(|item| Some((item, item.truth.media.as_ref()?)))
        .collect();
    let mut names: Vec<_> = clips.iter().map(|(_, media)| media.file_stem()).collect();
    names.sort();
    if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        let name = twice[0].unwrap_or_default().to_string_lossy();
        return Err(LabError::unsuitable(format!("two clips have a video named {name}: rename one")));
    }
    let run = |(): &mut (), i: usize| {
        stopped(cancel)?;
        let (item, media) = clips[i];
        let run = run(media, workplace, options, config, cancel, &Silent)?;
        tracing::info!("{}: focal {:.0} px", item.name, run.camera.focal_px);
        let frames = run.analysed(&item.truth);
        let processed: Vec<u64> = frames.iter().copied().collect();
        let camera = CameraAnswer {
            focal_px: run.camera.focal_px,
            plane: run.camera.plane(),
            covariance: run.camera.estimate().covariance,
        };
        let mut clip = score(item, Some(camera), &run.poses, &run.rows, &processed, &processed, atlas);
        clip.boxes = pictures(&run, &item.truth, &frames);
        progress.frame_done();
        Ok(clip)
    };
    try_in_parallel(clips.len(), || Ok(()), run)
}

fn score(
    item: &Item,
    camera: Option<CameraAnswer>,
    poses: &[PoseRecord],
    rows: &[TrackRow],
    processed: &[u64],
    sampled: &[u64],
    atlas: &ShapeAtlas,
) -> ClipScore {
    let truth = &item.truth;
    ClipScore {
        name: item.name.clone(),
        cars: truth.models.len(),
        poses: score_poses(truth, poses, atlas, |frame, _| sampled.contains(&frame)),
        tracks: score_tracks(truth, rows, |frame, _| processed.contains(&frame)),
        camera: camera.map(|camera| camera.error(truth.camera.focal_px, &truth.camera.plane())),
        boxes: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::dataset::evidence::from_truth;
    use nalgebra::{Point3, Vector2};
    use roadplane_metrics::truth::{Truth, read_truth};
    use roadplane_pipeline::{ConstraintOptions, solve_clip};
    use roadplane_write::JsonLines;

    /// Returns the picture position (px) of a point on the ground (m).
    fn pixel(truth: &Truth, x_m: f64, y_m: f64) -> Vector2<f64> {
        let point = truth.camera.plane().camera_from_world() * Point3::new(x_m, y_m, 0.0);
        truth.camera.camera().pixel_from_camera(&point.coords).unwrap()
    }

    /// Solves the rendered parking lot with a length from the user that is 6 % too long. The estimated world must be 6
    /// % larger.
    #[test]
    fn a_length_from_the_user_sets_the_scale_of_the_world() {
        const LARGER: f64 = 1.06;
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/lot.truth.json");
        let truth = read_truth(&path).unwrap();
        let (atlas, folder) = (ShapeAtlas::shipped().unwrap(), tempfile::tempdir().unwrap());
        let scene = from_truth(&truth, 0.003, 5, 3);
        let frames = folder.path().join("frames.jsonl");
        let mut lines = JsonLines::create(&frames).unwrap();
        for frame in &scene.frames {
            lines.write(&frame.record(&truth)).unwrap();
        }
        lines.finish().unwrap();
        // The measured line lies among the cars.
        let [from, to] = [-4.0, 4.0].map(|x_m| pixel(&truth, x_m, 24.0));
        let solve = |length_m: Option<f64>| {
            let lengths = folder.path().join("length.csv");
            let constraints = length_m.map_or_else(CameraConstraints::default, |length_m| {
                let table = format!(
                    "x1,y1,x2,y2,length_m,sd_m,pixel_sd\n{},{},{},{},{length_m},{},0.3\n",
                    from.x,
                    from.y,
                    to.x,
                    to.y,
                    0.01 * length_m
                );
                std::fs::write(&lengths, table).unwrap();
                CameraConstraints::new(&ConstraintOptions {
                    lengths: Some(&lengths),
                    ..ConstraintOptions::default()
                })
                .unwrap()
            });
            let poses = folder.path().join("poses.jsonl");
            solve_clip(&frames, &poses, &atlas, &constraints, &Config::default(), &Cancel::default()).unwrap()
        };
        // Slope of found against true positions in x. Each row is paired with the nearest true car.
        let sideways = |rows: &[TrackRow]| {
            let (mut products, mut squares) = (0.0, 0.0);
            for row in rows {
                let Some(frame) = truth.frames.iter().find(|frame| frame.frame == row.frame) else {
                    continue;
                };
                let positions =
                    frame.cars.iter().map(|car| [car.world_from_car[0][3], car.world_from_car[1][3]]);
                let off = |at: &[f64; 2]| (row.x_m / LARGER - at[0]).hypot(row.y_m / LARGER - at[1]);
                let nearest = positions.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
                products += row.x_m * nearest[0];
                squares += nearest[0] * nearest[0];
            }
            products / squares
        };
        let height = |solution: &roadplane_pipeline::ClipSolution| {
            let camera = &solution.cameras.estimates[0];
            (camera.params.log_height.exp() / truth.camera.height_m, camera.covariance[(3, 3)].sqrt())
        };
        let (without, with) = (solve(None), solve(Some(8.0 * LARGER)));
        let (alone, given) = (height(&without), height(&with));
        println!("without: {alone:?}, sideways {:.4}", sideways(&without.rows));
        println!("with one length: {given:?}, sideways {:.4}", sideways(&with.rows));
        assert!((sideways(&without.rows) - 1.0).abs() < 0.02, "cars alone do not determine the scale");
        assert!((sideways(&with.rows) / LARGER - 1.0).abs() < 0.012);
        // The height is computed from the horizon and the length, so it is no more accurate than the horizon.
        assert!((given.0 / LARGER).ln().abs() < 2.0 * given.1 && given.1 < 0.85 * alone.1);
        assert!(with.cameras.constraints[0].apart_sds < 3.0 && with.warnings.is_empty());
        let wrong = solve(Some(8.0 * 1.5));
        assert!(
            wrong.warnings.iter().any(|text| text.contains("length of line 2 of length.csv is")),
            "{:?}",
            wrong.warnings
        );
    }
}
