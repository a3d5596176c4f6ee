//! `roadplane eval run`: a finished run against truth.

use roadplane_base::ShapeAtlas;
use roadplane_lab::evaluate_run;

use crate::args::eval::EvalRunArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::Outcome;

/// Prints the tables.
pub fn run(args: &EvalRunArgs) -> anyhow::Result<Outcome> {
    let report = evaluate_run(&args.run, &args.truth, &ShapeAtlas::shipped()?)?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
