//! `roadplane-lab eval`: prints tables of scores, and writes the tables as files if a folder is given.

mod activity;
mod cameras;
mod dataset;
mod detector;
mod keypoints;
mod kitti;
mod motion;
mod regions;
mod run;
mod show;
mod solver;
mod speeds;
mod tracker;

use std::path::Path;

use crate::{LabError, evaluate_coco, evaluate_mot};
use roadplane_pipeline::Cancel;
use roadplane_tables::Report;

use crate::args::eval::{EvalArgs, EvalCommand, EvalFilesArgs};
use roadplane_terminal::Outcome;
use show::show;

/// Runs the evaluation that the arguments name.
pub fn eval(args: &EvalArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    match &args.command {
        EvalCommand::Run(args) => run::run(args),
        EvalCommand::Dataset(args) => dataset::dataset(args, cancel),
        EvalCommand::Regions(args) => regions::regions(args, cancel),
        EvalCommand::Motion(args) => motion::motion(args, cancel),
        EvalCommand::Activity(args) => activity::activity(args, cancel),
        EvalCommand::Kitti(args) => kitti::kitti(args, cancel),
        EvalCommand::Speeds(args) => speeds::speeds(args),
        EvalCommand::Tracks(args) => files(args, evaluate_mot),
        EvalCommand::Tracker(args) => tracker::tracker(args, cancel),
        EvalCommand::Boxes(args) => files(args, evaluate_coco),
        EvalCommand::Detector(args) => detector::detector(args, cancel),
        EvalCommand::Keypoints(args) => keypoints::keypoints(args, cancel),
        EvalCommand::Solver(args) => solver::solver(args, cancel),
        EvalCommand::Cameras(args) => cameras::cameras(args, cancel),
        EvalCommand::CameraDatabase(args) => solver::camera_database(args),
    }
}

/// Scores one file against a truth file, and shows the report.
fn files(
    args: &EvalFilesArgs,
    evaluate: impl Fn(&Path, &Path) -> Result<Report, LabError>,
) -> anyhow::Result<Outcome> {
    show(&evaluate(&args.truth, &args.found)?, args.out.as_deref())?;
    Ok(Outcome::Done)
}
