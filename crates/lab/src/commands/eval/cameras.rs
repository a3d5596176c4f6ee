//! `roadplane-lab eval cameras`: scores estimated cameras against real reference cameras.

use crate::evaluate_cameras;
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::EvalCamerasArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::{Bar, Outcome};

/// Prints the tables of the cameras' errors.
pub fn cameras(args: &EvalCamerasArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let report =
        evaluate_cameras(&args.folder, args.out.as_deref(), &models, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
