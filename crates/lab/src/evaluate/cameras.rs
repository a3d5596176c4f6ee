//! Scores estimated cameras against reference cameras, real or rendered. The tables show the errors of the cameras, and the causes
//! of these errors: errors of single cars and keypoints.

mod cars;
mod drawn;
mod measured;
mod outcome;
mod tables;
mod view_errors;

use std::path::{Path, PathBuf};

use roadplane_base::ShapeAtlas;
use roadplane_pipeline::{Cancel, Config, Existing, Progress, RunOptions, Silent, run_input, stem_of};
use roadplane_tables::Report;
use roadplane_write::FrameReader;

use crate::LabError;
use crate::workplace::Workplace;
use roadplane_metrics::readers::cameras::read_camera_folder;

use cars::cars_of;
use measured::Measured;
use outcome::outcome;

/// Runs the pictures and clips of a folder, and compares the estimated cameras with the reference cameras.
///
/// The folder has `cameras.json`, or it is a rendered data set.
///
/// Finished runs in the folder `out` are reused. `models` is the folder of the nets, and `config` is the configuration
/// of the runs. The report has drawings of the cameras with the largest errors. A camera with strong lens distortion
/// appears only in the table of single cameras.
///
/// # Errors
/// [`LabError`] if a file cannot be read, a run fails, or the user stops the work.
pub fn evaluate_cameras(
    folder: &Path,
    out: Option<&Path>,
    models: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let atlas = ShapeAtlas::shipped().map_err(roadplane_pipeline::PipelineError::from)?;
    let workplace = Workplace::new(out)?;
    let runs = workplace.folder().join("runs");
    let cameras = read_camera_folder(folder)?;
    progress.expect(Some(cameras.len() as u64));
    let mut measured = Vec::new();
    for camera in cameras {
        let frames = frames_of(&camera.media, &runs, models, config, cancel)?;
        let outcome = outcome(&camera, &frames, config, cancel)?;
        let first = FrameReader::open(&frames)?.next().transpose()?;
        let cars = first.map(|frame| cars_of(&camera, &frame, &atlas, config)).unwrap_or_default();
        measured.push(Measured { camera, outcome, cars });
        progress.frame_done();
    }
    Ok(Report { pictures: drawn::worst(&measured, &atlas, config)?, ..tables::report(&measured) })
}

/// Returns the path of the file `frames.jsonl` that a run of the picture or clip `media` writes. An existing file is
/// reused.
fn frames_of(
    media: &Path,
    runs: &Path,
    models: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<PathBuf, LabError> {
    let frames = runs.join(stem_of(media)).join("frames.jsonl");
    if !frames.is_file() {
        let wanted = RunOptions {
            existing: Existing::Overwrite,
            frames: true,
            ..RunOptions::new(models.to_path_buf())
        };
        run_input(media, runs, &wanted, config, cancel, &Silent)?;
    }
    Ok(frames)
}
