//! `roadplane plan` and `roadplane join`: process a long input in pieces.

use std::io::{Write as _, stdout};

use roadplane_pipeline::{
    CameraDatabase, Cancel, Existing, FolderLock, PipelineError, RunOptions, check_traffic, find_models,
    inputs_of, join_pieces, plan as plan_input,
};

use crate::args::pieces::{JoinArgs, PlanArgs};
use roadplane_terminal::{Bar, Outcome};

/// Lists the pieces of all inputs. If an input cannot be read, the command continues with the next input.
pub fn plan(args: &PlanArgs) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let mut lost = None;
    for input in &args.inputs {
        match plan_input(input, args.piece_s, &config) {
            Ok(pieces) => {
                for piece in pieces {
                    writeln!(stdout(), "{}", serde_json::to_string(&piece)?)?;
                }
            }
            Err(error) => {
                if let Some(before) = lost.replace(error) {
                    tracing::error!("{before}");
                }
            }
        }
    }
    lost.map_or(Ok(Outcome::Done), |error| Err(error.into()))
}

/// Joins the pieces of an input into the result of one run.
pub fn join(args: &JoinArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let constraints = args.known.read_for_database(args.cameras.is_some())?;
    let site = super::site::site(&args.site)?;
    check_traffic(&config.traffic)?;
    let models = find_models(config.models.folder.as_deref())?;
    let _lock = FolderLock::acquire(&args.out).map_err(PipelineError::from)?;
    let cameras = match (&args.cameras, &args.camera_id) {
        (Some(folder), Some(id)) => Some(CameraDatabase::open(folder, id, &inputs_of(&args.pieces)?)?),
        _ => None,
    };
    let options = RunOptions {
        constraints,
        cameras,
        site,
        existing: if args.overwrite { Existing::Overwrite } else { Existing::Refuse },
        resume: args.resume,
        frames: args.frames,
        ..RunOptions::new(models)
    };
    let report = join_pieces(&args.pieces, &args.out, &options, &config, cancel, &Bar::new("join"))?;
    if let Some(cameras) = &options.cameras {
        cameras.learn(&report.folder)?;
    }
    let tracks = report.tracks.map_or_else(String::new, |n| format!("{n} tracks, "));
    tracing::info!("{tracks}{}: {}", report.camera, report.folder.display());
    Ok(if report.is_partial() { Outcome::Damaged } else { Outcome::Done })
}
