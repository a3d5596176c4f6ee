//! `roadplane run` for one input: stream it, solve the clip, write and draw the result.

use std::path::Path;
use std::time::Instant;

use roadplane_activity::ActivityNet;
use roadplane_write::{OutputFolder, RunStatus, read_summary};

use crate::estimation::ClipSolution;
use crate::identity::stem_of;
use crate::options::{RunOptions, RunReport};
use crate::output::finish::{Finish, finish};
use crate::stream::perception::{Job, Left, LeftHalf, SPOOL, STAMP, left_half};
use crate::stream::speed::Meter;
use crate::stream::streaming::open_input;
use crate::{Cancel, Config, PipelineError, Progress};

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
