//! `roadplane stage`: runs one stage alone, from an input file to an output file.

use std::path::Path;

use roadplane_pipeline::{
    Cancel, Existing, FolderLock, PipelineError, SolveMethod, SolveOptions, activity_file, detect_file,
    find_models, keypoints_file, solve_file, track_file,
};

use crate::args::stage::{ActivityArgs, DetectArgs, KeypointsArgs, MethodArg, SolveArgs, TrackArgs};
use crate::sandbox::{self, Needs};
use roadplane_terminal::{Bar, Outcome};

fn outcome(is_partial: bool) -> Outcome {
    if is_partial { Outcome::Damaged } else { Outcome::Done }
}

/// Detects the vehicles of an input, and writes frames with boxes.
pub fn detect(args: &DetectArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    sandbox::enter(
        &Needs::of_nets(config.models.folder.as_deref()).reading([&args.input]).writing_file(&args.out),
    );
    let bar = Bar::new("detect");
    Ok(outcome(detect_file(&args.input, &args.out, &models, &config, cancel, &bar)?))
}

/// Finds the keypoints in the given boxes of an input, and writes frames with keypoints.
pub fn keypoints(args: &KeypointsArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let reads = [&args.input, &args.boxes];
    sandbox::enter(&Needs::of_nets(config.models.folder.as_deref()).reading(reads).writing_file(&args.out));
    let bar = Bar::new("keypoints");
    Ok(outcome(keypoints_file(&args.input, &args.boxes, &args.out, &models, &config, cancel, &bar)?))
}

/// Reads tracks, and writes activity labels and events.
pub fn activity(args: &ActivityArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let events = activity_file(&args.tracks, &args.out, &models, &config, cancel)?;
    tracing::info!("{events} events");
    Ok(Outcome::Done)
}

/// Reads frames with keypoints, and writes poses and a camera.
pub fn solve(args: &SolveArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let constraints = args.known.read()?;
    let method = match args.method {
        MethodArg::Paper if args.no_plane => {
            return Err(PipelineError::usage("--method paper needs the plane: remove --no-plane").into());
        }
        MethodArg::Paper => SolveMethod::Paper,
        MethodArg::Joint if args.no_plane => SolveMethod::Free,
        MethodArg::Joint if args.per_frame => SolveMethod::PerFrame,
        MethodArg::Joint => SolveMethod::Joint,
    };
    let options = SolveOptions { constraints, method };
    Ok(outcome(solve_file(&args.frames, &args.out, &options, &config, cancel, &Bar::new("solve"))?))
}

/// Reads frames with keypoints, and writes tracks.
pub fn track(args: &TrackArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let constraints = args.known.read()?;
    let (out, stem) = (args.out.parent().unwrap_or_else(|| Path::new("")), stem_of_folder(&args.out));
    let out = if out.as_os_str().is_empty() { Path::new(".") } else { out };
    let _lock = FolderLock::acquire(out).map_err(PipelineError::from)?;
    let existing = if args.overwrite { Existing::Overwrite } else { Existing::Refuse };
    let report = track_file(&args.frames, out, &stem, &constraints, existing, &config, cancel)?;
    let tracks = report.tracks.unwrap_or(0);
    tracing::info!("{tracks} tracks, {}: {}", report.camera, report.folder.display());
    Ok(outcome(report.is_partial()))
}

fn stem_of_folder(folder: &Path) -> String {
    folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}
