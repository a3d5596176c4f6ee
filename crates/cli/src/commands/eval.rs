//! `roadplane eval`: tables on the standard output, and as files where a folder is asked for.

mod keypoints;
mod run;
mod solver;

use std::io::Write as _;
use std::path::Path;

use roadplane_eval::Report;
use roadplane_pipeline::Cancel;

use crate::Outcome;
use crate::args::eval::{EvalArgs, EvalCommand};

/// Evaluates what is asked for.
pub fn eval(args: &EvalArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    match &args.command {
        EvalCommand::Run(args) => run::run(args),
        EvalCommand::Keypoints(args) => keypoints::keypoints(args, cancel),
        EvalCommand::Solver(args) => solver::solver(args),
    }
}

/// Prints a report's tables; writes them with the plots where a folder is given.
fn show(report: &Report, out: Option<&Path>) -> anyhow::Result<()> {
    if let Some(folder) = out {
        report.write(folder)?;
    }
    Ok(std::io::stdout().lock().write_all(report.to_text().as_bytes())?)
}
