//! `roadplane eval cameras`: real cameras that are known.

use roadplane_eval::evaluate_cameras;
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::EvalCamerasArgs;
use crate::commands::config::config;
use crate::commands::eval::show::show;
use crate::outcome::Outcome;
use crate::progress::Bar;

/// Prints the tables.
pub fn cameras(args: &EvalCamerasArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = config(&args.config)?;
    let models = find_models(config.models.folder.as_deref())?;
    let report =
        evaluate_cameras(&args.folder, args.out.as_deref(), &models, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
