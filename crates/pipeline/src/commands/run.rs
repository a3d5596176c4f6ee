//! Command `roadplane run` for one input: runs perception and estimation and writes the files of the result.

use std::path::Path;
use std::time::Instant;

use roadplane_activity::ActivityNet;
use roadplane_write::{OutputFolder, read_summary};

use crate::error::Fault;
use crate::estimation::ClipSolution;
use crate::identity::stem_of;
use crate::options::{RunOptions, RunReport};
use crate::output::finish::{Finish, finish};
use crate::stream::perception::{Job, Perceived, Perception, SPOOL, STAMP, perceive};
use crate::stream::speed::Meter;
use crate::stream::streaming::open_input;
use crate::{Cancel, Config, PipelineError, Progress};

/// Processes one input and writes the result to `out/<stem>/`, where `<stem>` is the name of the result. The caller
/// must have the lock of the folder `out`.
///
/// # Errors
/// Returns a [`PipelineError`] if the result cannot be completed. `out/<stem>/` is then unchanged. After a request to
/// stop or an internal fault, the unfinished work is kept elsewhere, and a run with `options.resume` continues it.
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
    let Perception { folder, perceived, activity, meter, .. } =
        perceive(input_path, input, None, (out, &stem), meter, &job)?;
    complete(folder, perceived.map(|perceived| (perceived, activity)), &stem, started, Some(meter), &job)
}

/// Runs estimation on the results of perception and gives the folder of the result its final name.
pub(crate) fn complete(
    folder: OutputFolder,
    perceived: Result<(Perceived, Option<ActivityNet>), PipelineError>,
    stem: &str,
    started: Instant,
    meter: Option<Meter>,
    job: &Job<'_>,
) -> Result<RunReport, PipelineError> {
    let path = folder.path().to_path_buf();
    let result = perceived.and_then(|(perceived, activity)| {
        let work = Finish { folder: &path, stem, perceived: &perceived, activity, started, meter };
        let solution = finish(work, job)?;
        Ok((perceived, solution))
    });
    publish(folder, result, job.options)
}

/// Returns the report of a result that an earlier run finished. `None` if there is no such result or the run does not
/// resume earlier work.
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
        status: summary.status,
        frames_lost: summary.counts.frames_lost,
        frames_not_followed: summary.counts.frames_not_followed,
    }))
}

/// Deletes the folder of an unfinished result after an error from which no later run can continue. After a request to
/// stop, or a fault of the machine such as a full disk, the folder stays for a run that resumes it.
pub(crate) fn discarded(folder: OutputFolder, error: PipelineError) -> PipelineError {
    if matches!(error.fault(), Fault::Stopped { .. } | Fault::Internal) {
        return error;
    }
    folder.discard().err().map_or(error, PipelineError::from)
}

/// Deletes the temporary files of a result and gives its folder the final name.
fn publish(
    folder: OutputFolder,
    result: Result<(Perceived, ClipSolution), PipelineError>,
    options: &RunOptions,
) -> Result<RunReport, PipelineError> {
    let (Perceived { decode, .. }, solution) = match result {
        Ok(done) => done,
        Err(error) => return Err(discarded(folder, error)),
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
        status: solution.status(decode.is_damaged()),
        frames_lost: decode.missing,
        frames_not_followed: solution.not_followed.frames,
    })
}
