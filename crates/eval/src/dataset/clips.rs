//! Clips: fused from the same keypoints as the other rows, and run from the video alone.

use std::path::{Path, PathBuf};

use roadplane_base::{PoseRecord, ShapeAtlas, TrackRow};
use roadplane_pipeline::{Cancel, Config, Existing, Known, Progress, RunOptions, Silent, run_input};
use roadplane_write::WriteError;

use super::evidence::SceneEvidence;
use super::{DatasetOptions, Item, stopped};
use crate::EvalError;
use crate::metrics::average_precision::PictureBoxes;
use crate::metrics::camera::CameraError;
use crate::parallel::try_in_parallel;
use crate::run::{FinishedRun, pictures};
use crate::scoring::{PoseScore, TrackScore, score_poses, score_tracks};
use crate::systems::{CameraAnswer, solve_fused};
use crate::truth::Kind;

/// Where files of runs lie while they are needed, or for good.
pub(super) struct Workplace {
    folder: PathBuf,
    /// Removes the folder at the end.
    _temporary: Option<tempfile::TempDir>,
}

impl Workplace {
    /// In `keep`, else somewhere for the time being.
    pub fn new(keep: Option<&Path>) -> Result<Self, EvalError> {
        if let Some(keep) = keep {
            std::fs::create_dir_all(keep).map_err(|source| no_folder(source, keep))?;
            return Ok(Self { folder: keep.to_path_buf(), _temporary: None });
        }
        let temporary = temporary_folder()?;
        Ok(Self { folder: temporary.path().to_path_buf(), _temporary: Some(temporary) })
    }

    /// A run of one input, made anew.
    pub fn run(
        &self,
        input: &Path,
        options: &DatasetOptions,
        config: &Config,
        cancel: &Cancel,
        progress: &dyn Progress,
    ) -> Result<FinishedRun, EvalError> {
        let options = RunOptions { existing: Existing::Overwrite, ..RunOptions::new(options.models.clone()) };
        let report = run_input(input, &self.folder, &options, config, cancel, progress)?;
        FinishedRun::read(&report.folder)
    }
}

pub(crate) fn temporary_folder() -> Result<tempfile::TempDir, EvalError> {
    tempfile::tempdir().map_err(|source| no_folder(source, Path::new("temporary")))
}

fn no_folder(source: std::io::Error, path: &Path) -> EvalError {
    EvalError::from(WriteError::Io { doing: "make the folder", source, path: path.to_path_buf() })
}

/// What a clip came to.
#[derive(Clone, Debug)]
pub(super) struct ClipScore {
    pub name: String,
    /// How many cars appear in it.
    pub cars: usize,
    /// Cars of the frames that the other systems solve too.
    pub poses: Vec<PoseScore>,
    /// All frames that were looked at.
    pub tracks: TrackScore,
    pub camera: Option<CameraError>,
    /// Boxes of every frame; empty where they were given.
    pub boxes: Vec<PictureBoxes>,
}

/// Row 6 from given keypoints.
pub(super) fn fused(
    item: &Item,
    scene: &SceneEvidence,
    frames: usize,
    atlas: &ShapeAtlas,
    config: &Config,
    cancel: &Cancel,
) -> Result<ClipScore, EvalError> {
    let folder = temporary_folder()?;
    let records: Vec<_> = scene.frames.iter().map(|frame| frame.record(&item.truth)).collect();
    let clip = solve_fused(atlas, &records, &Known::default(), folder.path(), config, cancel)?;
    let looked_at: Vec<u64> = records.iter().map(|record| record.frame).collect();
    let sampled: Vec<u64> = scene.sample(frames).into_iter().map(|place| looked_at[place]).collect();
    Ok(score(item, clip.camera, &clip.poses, &clip.rows, &looked_at, &sampled, atlas))
}

/// Row 6 from the video alone: our boxes, our keypoints, nothing known. For each clip that has a video.
pub(super) fn run_all(
    items: &[Item],
    atlas: &ShapeAtlas,
    workplace: &Workplace,
    options: &DatasetOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Vec<ClipScore>, EvalError> {
    let clips: Vec<(&Item, &PathBuf)> = items
        .iter()
        .filter(|item| item.truth.kind == Kind::Clip)
        .filter_map(|item| Some((item, item.truth.media.as_ref()?)))
        .collect();
    let mut names: Vec<_> = clips.iter().map(|(_, media)| media.file_stem()).collect();
    names.sort();
    if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        let name = twice[0].unwrap_or_default().to_string_lossy();
        return Err(EvalError::Unsuitable {
            what: format!("two clips have a video named {name}: rename one"),
        });
    }
    let run = |(): &mut (), i: usize| {
        stopped(cancel)?;
        let (item, media) = clips[i];
        let run = workplace.run(media, options, config, cancel, &Silent)?;
        tracing::info!("{}: focal {:.0} px", item.name, run.camera.focal_px);
        let frames = run.analysed(&item.truth);
        let looked_at: Vec<u64> = frames.iter().copied().collect();
        let camera = CameraAnswer {
            focal_px: run.camera.focal_px,
            plane: run.camera.plane(),
            covariance: run.camera.estimate().covariance,
        };
        let mut clip = score(item, Some(camera), &run.poses, &run.rows, &looked_at, &looked_at, atlas);
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
    looked_at: &[u64],
    sampled: &[u64],
    atlas: &ShapeAtlas,
) -> ClipScore {
    let truth = &item.truth;
    ClipScore {
        name: item.name.clone(),
        cars: truth.models.len(),
        poses: score_poses(truth, poses, atlas, |frame, _| sampled.contains(&frame)),
        tracks: score_tracks(truth, rows, |frame, _| looked_at.contains(&frame)),
        camera: camera.map(|camera| camera.error(truth.camera.focal_px, &truth.camera.plane())),
        boxes: Vec::new(),
    }
}
