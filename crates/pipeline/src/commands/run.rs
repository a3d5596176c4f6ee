//! `roadplane run` for one input: stream it, solve the clip, write and draw the result.

use std::path::{Path, PathBuf};
use std::time::Instant;

use roadplane_activity::ActivityNet;
use roadplane_geo::Site;
use roadplane_write::{Existing, OutputFolder, RunStatus, read_summary};

use crate::cameras::memory::CameraMemory;
use crate::clip::ClipSolution;
use crate::output::finish::{Finish, finish};
use crate::stream::left::{Job, Left, LeftHalf, SPOOL, STAMP, left_half};
use crate::stream::speed::Meter;
use crate::stream::streaming::open_input;
use crate::{Cancel, Config, Known, PipelineError, Progress};

/// What a caller of [`run_input`] chooses besides the configuration.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Folder of the models.
    pub models: PathBuf,
    /// What is known of the camera.
    pub known: Known,
    /// What is remembered of the cameras.
    pub cameras: Option<CameraMemory>,
    /// Where the camera stands on the map; one for all inputs.
    pub site: Option<Site>,
    /// What to do about a finished result of the same name.
    pub existing: Existing,
    /// Go on where a stopped run ended; leave finished results alone.
    pub resume: bool,
    /// Also write the annotated video.
    pub video: bool,
    /// Also write the empty place as a picture.
    pub background: bool,
    /// Leave what the streaming half found, frame by frame, in the result: `frames.jsonl`.
    pub frames: bool,
    /// No other input is worked on in this process at the same time: its processor time is this run's.
    pub alone: bool,
}

impl RunOptions {
    /// Nothing asked for beside the results, which must not be there yet.
    #[must_use]
    pub fn new(models: PathBuf) -> Self {
        Self {
            models,
            known: Known::default(),
            cameras: None,
            site: None,
            existing: Existing::Refuse,
            resume: false,
            video: false,
            background: false,
            frames: false,
            alone: false,
        }
    }
}

/// What came of one input.
#[derive(Clone, Debug)]
pub struct RunReport {
    /// The result.
    pub folder: PathBuf,
    /// Tracks in it; `None` for a result that was there before.
    pub tracks: Option<u64>,
    /// The camera in words.
    pub camera: String,
    /// Some of the input was lost.
    pub damaged: bool,
    /// Frames that could not be decoded.
    pub frames_lost: u64,
}

/// Name of an input's result folder: its file name without extension, or the folder's name.
#[must_use]
pub fn stem_of(input: &Path) -> String {
    let absolute = std::path::absolute(input).unwrap_or_else(|_unresolvable| input.to_path_buf());
    let name = if absolute.is_dir() { absolute.file_name() } else { absolute.file_stem() };
    name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Runs one input into `out/<stem>/`. Hold the lock of `out`.
///
/// # Errors
/// [`PipelineError`]; nothing then appears under the final name. What a stopped run did stays for `resume`.
pub fn run_input(
    input_path: &Path,
    out: &Path,
    options: &RunOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let started = Instant::now();
    let meter = Meter::start(options.alone);
    let stem = stem_of(input_path);
    if let Some(report) = finished_before(&out.join(&stem), options)? {
        return Ok(report);
    }
    let input = open_input(input_path, config)?;
    let job = Job { options, config, cancel, progress };
    let LeftHalf { folder, left, activity, meter, .. } =
        left_half(input_path, input, None, (out, &stem), meter, &job)?;
    complete(folder, left.map(|left| (left, activity)), &stem, started, Some(meter), &job)
}

/// The right half of a run over what the left one left, and the result's name.
pub(crate) fn complete(
    folder: OutputFolder,
    left: Result<(Left, Option<ActivityNet>), PipelineError>,
    stem: &str,
    started: Instant,
    meter: Option<Meter>,
    job: &Job<'_>,
) -> Result<RunReport, PipelineError> {
    let path = folder.path().to_path_buf();
    let result = left.and_then(|(left, activity)| {
        let work = Finish { folder: &path, stem, left: &left, activity, started, meter };
        let solution = finish(work, job)?;
        Ok((left, solution))
    });
    publish(folder, result, job.options)
}

/// What a run with `resume` finds done.
pub(crate) fn finished_before(
    finished: &Path,
    options: &RunOptions,
) -> Result<Option<RunReport>, PipelineError> {
    let summary = finished.join("summary.json");
    if !(options.resume && summary.is_file()) {
        return Ok(None);
    }
    let summary = read_summary(&summary)?;
    Ok(Some(RunReport {
        folder: finished.to_path_buf(),
        tracks: None,
        camera: "finished before".to_owned(),
        damaged: summary.status == RunStatus::InputDamaged,
        frames_lost: summary.counts.frames_lost,
    }))
}

/// Only a stopped run leaves something to go on from.
pub(crate) fn given_up(folder: OutputFolder, error: PipelineError) -> PipelineError {
    if matches!(error, PipelineError::Stopped { .. }) {
        return error;
    }
    folder.discard().err().map_or(error, PipelineError::from)
}

/// Gives a result its name, without its work files.
fn publish(
    folder: OutputFolder,
    result: Result<(Left, ClipSolution), PipelineError>,
    options: &RunOptions,
) -> Result<RunReport, PipelineError> {
    let (Left { decode, .. }, solution) = match result {
        Ok(done) => done,
        Err(error) => return Err(given_up(folder, error)),
    };
    let work_files = if options.frames { &[STAMP][..] } else { &[STAMP, SPOOL] };
    for work_file in work_files {
        let path = folder.path().join(work_file);
        std::fs::remove_file(&path).map_err(|source| PipelineError::Unreadable { source, path })?;
    }
    Ok(RunReport {
        folder: folder.publish()?,
        tracks: Some(solution.shapes.len() as u64),
        camera: solution.camera_in_words(),
        damaged: decode.is_damaged(),
        frames_lost: decode.missing,
    })
}
