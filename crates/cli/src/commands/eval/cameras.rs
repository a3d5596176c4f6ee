//! `roadplane eval cameras`: real cameras that are known.

use roadplane_eval::evaluate_cameras;
use roadplane_pipeline::{Cancel, find_models};

use crate::Outcome;
use crate::args::eval::EvalCamerasArgs;
use crate::progress::Bar;

/// Prints the tables.
pub fn cameras(args: &EvalCamerasArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = super::super::config(&args.config)?;
    let models = find_models(config.models.folder.as_deref())?;
    let report =
        evaluate_cameras(&args.folder, args.out.as_deref(), &models, &config, cancel, &Bar::new("eval"))?;
    super::show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
