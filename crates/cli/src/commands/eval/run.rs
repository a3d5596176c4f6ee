//! `roadplane eval run`: a finished run against truth.

use roadplane_base::ShapeAtlas;
use roadplane_eval::evaluate_run;

use crate::Outcome;
use crate::args::eval::EvalRunArgs;

/// Prints the tables.
pub fn run(args: &EvalRunArgs) -> anyhow::Result<Outcome> {
    let report = evaluate_run(&args.run, &args.truth, &ShapeAtlas::shipped()?)?;
    super::show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
