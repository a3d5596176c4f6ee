//! `roadplane-lab eval run`: scores a finished run against truth.

use crate::evaluate_run;
use roadplane_base::ShapeAtlas;

use crate::args::eval::EvalRunArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::Outcome;

/// Prints the tables of a finished run's scores.
pub fn run(args: &EvalRunArgs) -> anyhow::Result<Outcome> {
    let report = evaluate_run(&args.run, &args.truth, &ShapeAtlas::shipped()?)?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
