//! `roadplane-lab eval speeds`: scores speeds against measured ones.

use crate::{MeasuredSpeeds, evaluate_speeds};

use crate::args::eval::EvalSpeedsArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::Outcome;

/// Prints the table of the errors of speeds.
pub fn speeds(args: &EvalSpeedsArgs) -> anyhow::Result<Outcome> {
    let measured = if args.truth.is_empty() {
        MeasuredSpeeds::Passings { files: args.passings.clone(), traffic: args.traffic.clone() }
    } else {
        MeasuredSpeeds::Truth { files: args.truth.clone(), distance_m: args.distance_m }
    };
    show(&evaluate_speeds(&args.runs, &measured)?, args.out.as_deref())?;
    Ok(Outcome::Done)
}
