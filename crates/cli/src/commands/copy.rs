//! `roadplane copy`: turns a finished run into a scene for simulators.

use std::path::PathBuf;

use roadplane_base::{ShapeAtlas, TrackRow};
use roadplane_copy::{Colours, Scene, write_scene};
use roadplane_export::Run;
use roadplane_pipeline::{Cancel, Existing, FolderLock, PipelineError, track_colours};
use roadplane_write::{OutputFolder, WriteError, read_summary};

use super::split;
use crate::args::copy::CopyArgs;
use roadplane_terminal::{Bar, Outcome};

/// Reads the run, samples the colours of vehicles from its input, and writes the scene.
pub fn copy(args: &CopyArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let run = Run::read(&args.run).map_err(PipelineError::from)?;
    let atlas = ShapeAtlas::shipped().map_err(PipelineError::from)?;
    let colours = colours(args, &run, cancel)?;
    let Some(scene) = Scene::of(&run, &colours, &atlas) else {
        let what = "the run has no vehicle to copy".to_owned();
        return Err(PipelineError::from(WriteError::Malformed { what, path: args.run.clone() }).into());
    };
    if run.segments.len() > 1 {
        tracing::warn!("the camera was moved: only the longest segment is copied: {}", scene.name);
    }
    if scene.is_flattened() {
        tracing::warn!("the ground is two planes, but the copy is flat: {}", scene.name);
    }
    let (parent, name) = split(&args.out)?;
    let existing = if args.overwrite { Existing::Overwrite } else { Existing::Refuse };
    let _lock = FolderLock::acquire(&parent).map_err(PipelineError::from)?;
    let written = OutputFolder::write(&parent, &name, existing, |folder| write_scene(&scene, folder))
        .map_err(PipelineError::from)?;
    let stationary = scene.vehicles.iter().filter(|vehicle| vehicle.is_stationary()).count();
    tracing::info!(
        "{} vehicles, {stationary} of them stationary, {:.1} s: {}",
        scene.vehicles.len(),
        scene.seconds(),
        written.display()
    );
    Ok(Outcome::Done)
}

fn colours(args: &CopyArgs, run: &Run, cancel: &Cancel) -> anyhow::Result<Colours> {
    let input = match &args.input {
        Some(input) => input.clone(),
        None => {
            let summary = read_summary(&args.run.join("summary.json")).map_err(PipelineError::from)?;
            let input = PathBuf::from(summary.input.path);
            if !input.exists() {
                tracing::warn!(
                    "vehicles are grey, because the input is missing (name it with --input): {}",
                    input.display()
                );
                return Ok(Colours::new());
            }
            input
        }
    };
    let rows: Vec<TrackRow> = run.tracks.iter().flat_map(|track| track.rows.clone()).collect();
    let config = args.config.load()?;
    Ok(track_colours(&input, &rows, &config, cancel, &Bar::new("colours"))?)
}
