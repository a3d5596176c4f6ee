//! `roadplane eval`: tables on the standard output, and as files where a folder is asked for.

mod activity;
mod attention;
mod cameras;
mod dataset;
mod keypoints;
mod kitti;
mod run;
mod solver;
mod tracker;

use std::io::Write as _;
use std::path::Path;

use roadplane_eval::{EvalError, evaluate_coco, evaluate_mot};
use roadplane_pipeline::Cancel;
use roadplane_tables::Report;

use crate::Outcome;
use crate::args::eval::{EvalArgs, EvalCommand, EvalFilesArgs};

/// Evaluates what is asked for.
pub fn eval(args: &EvalArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    match &args.command {
        EvalCommand::Run(args) => run::run(args),
        EvalCommand::Dataset(args) => dataset::dataset(args, cancel),
        EvalCommand::Attention(args) => attention::attention(args, cancel),
        EvalCommand::Activity(args) => activity::activity(args, cancel),
        EvalCommand::Kitti(args) => kitti::kitti(args, cancel),
        EvalCommand::Tracks(args) => files(args, evaluate_mot),
        EvalCommand::Tracker(args) => tracker::tracker(args, cancel),
        EvalCommand::Boxes(args) => files(args, evaluate_coco),
        EvalCommand::Keypoints(args) => keypoints::keypoints(args, cancel),
        EvalCommand::Solver(args) => solver::solver(args, cancel),
        EvalCommand::Cameras(args) => cameras::cameras(args, cancel),
        EvalCommand::Remembered(args) => solver::remembered(args),
    }
}

/// Compares two files.
fn files(
    args: &EvalFilesArgs,
    evaluate: impl Fn(&Path, &Path) -> Result<Report, EvalError>,
) -> anyhow::Result<Outcome> {
    show(&evaluate(&args.truth, &args.found)?, args.out.as_deref())?;
    Ok(Outcome::Done)
}

/// Prints a report's tables; writes them with the plots where a folder is given.
fn show(report: &Report, out: Option<&Path>) -> anyhow::Result<()> {
    if let Some(folder) = out {
        report.write(folder).map_err(EvalError::from)?;
    }
    Ok(std::io::stdout().lock().write_all(report.to_text().as_bytes())?)
}
