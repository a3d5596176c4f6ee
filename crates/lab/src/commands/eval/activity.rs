//! `roadplane-lab eval activity`: activities of vehicles against truth.

use crate::{ActivityOptions, evaluate_activity};
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::EvalActivityArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::{Bar, Outcome};

/// Prints the tables of scores of predicted activities.
pub fn activity(args: &EvalActivityArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let options = ActivityOptions { models, runs: args.out.as_ref().map(|out| out.join("runs")) };
    let report = evaluate_activity(&args.data, &options, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
