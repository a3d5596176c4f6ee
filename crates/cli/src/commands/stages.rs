//! `roadplane detect`, `keypoints`, `solve`, `activity`: one stage alone, on files.

use roadplane_pipeline::{
    Cancel, PipelineError, SolveOptions, activity_file, detect_file, find_models, keypoints_file, solve_file,
};

use crate::Outcome;
use crate::args::{ActivityArgs, DetectArgs, KeypointsArgs, SolveArgs};
use crate::progress::Bar;

fn outcome(damaged: bool) -> Outcome {
    if damaged { Outcome::Damaged } else { Outcome::Done }
}

/// Input → frames with boxes.
pub fn detect(args: &DetectArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = super::config(&args.config)?;
    let models = find_models(config.models.folder.as_deref())?;
    let bar = Bar::new("detect");
    Ok(outcome(detect_file(&args.input, &args.out, &models, &config, cancel, &bar)?))
}

/// Input and boxes → frames with keypoints.
pub fn keypoints(args: &KeypointsArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = super::config(&args.config)?;
    let models = find_models(config.models.folder.as_deref())?;
    let bar = Bar::new("keypoints");
    Ok(outcome(keypoints_file(&args.input, &args.boxes, &args.out, &models, &config, cancel, &bar)?))
}

/// Tracks → labels and events.
pub fn activity(args: &ActivityArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = super::config(&args.config)?;
    let models = find_models(config.models.folder.as_deref())?;
    let events = activity_file(&args.tracks, &args.out, &models, &config, cancel)?;
    tracing::info!("{events} events");
    Ok(Outcome::Done)
}

/// Frames with keypoints → poses and camera.
pub fn solve(args: &SolveArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = super::config(&args.config)?;
    if args.focal_px.is_some_and(|f| !(f.is_finite() && f > 0.0)) {
        return Err(PipelineError::usage("--focal-px must be a positive number").into());
    }
    let options =
        SolveOptions { focal_px: args.focal_px, use_plane: !args.no_plane, per_frame: args.per_frame };
    Ok(outcome(solve_file(&args.frames, &args.out, &options, &config, cancel)?))
}
