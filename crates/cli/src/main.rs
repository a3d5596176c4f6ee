//! The `roadplane` binary: parses the command line, runs one command, and converts its outcome to an exit code.
//!
//! - `args/`: the arguments
//! - `commands/`: one file per command
//! - `metrics.rs`: counts for Prometheus
//! - `sandbox.rs`: limits the files and addresses that a run can use
//!
//! The crate `terminal` contains the parts that `roadplane` shares with `roadplane-lab`.
// The doc comments of arguments are help texts. In them, <name> is not an HTML tag and [,height_m] is not a link.
#![allow(rustdoc::invalid_html_tags, rustdoc::broken_intra_doc_links)]

mod args;
mod commands;
mod metrics;
mod sandbox;

use std::process::ExitCode;

use clap::FromArgMatches as _;
use roadplane_pipeline::PipelineError;
use roadplane_terminal::{exit_code, help, refuse_small_address_space};

use args::stage::Stage;
use args::{Cli, Command};

fn main() -> ExitCode {
    if let Some(refused) = refuse_small_address_space() {
        return refused;
    }
    let cli = Cli::from_arg_matches(&Cli::described().get_matches()).unwrap_or_else(|error| error.exit());
    let cancel = cli.common.start();
    let outcome = match &cli.command {
        Command::Run(args) => commands::run::run(args, &cancel),
        Command::Render(args) => commands::render::render(args, &cancel),
        Command::Distance(args) => commands::distance::distance(args),
        Command::Cameras(args) => commands::cameras::cameras(args),
        Command::Plan(args) => commands::pieces::plan(args),
        Command::Join(args) => commands::pieces::join(args, &cancel),
        Command::Traffic(args) => commands::traffic::traffic(args),
        Command::Export(args) => commands::export::export(args),
        Command::Copy(args) => commands::copy::copy(args, &cancel),
        Command::Schemas(args) => commands::schemas::schemas(args),
        Command::Doctor(args) => commands::doctor::doctor(args),
        Command::Stage(args) => match &args.stage {
            Stage::Detect(args) => commands::stages::detect(args, &cancel),
            Stage::Keypoints(args) => commands::stages::keypoints(args, &cancel),
            Stage::Solve(args) => commands::stages::solve(args, &cancel),
            Stage::Track(args) => commands::stages::track(args, &cancel),
            Stage::Activity(args) => commands::stages::activity(args, &cancel),
        },
        Command::Detect(args) => commands::stages::detect(args, &cancel),
        Command::Keypoints(args) => commands::stages::keypoints(args, &cancel),
        Command::Solve(args) => commands::stages::solve(args, &cancel),
        Command::Track(args) => commands::stages::track(args, &cancel),
        Command::Activity(args) => commands::stages::activity(args, &cancel),
        Command::Eval(_) | Command::Bench(_) | Command::Synth(_) => commands::lab::lab(),
        Command::Man { out } => help::manual(Cli::described(), out),
        Command::Completions { shell } => help::completions(Cli::described(), *shell),
    };
    exit_code(outcome, |error| error.downcast_ref::<PipelineError>().map(PipelineError::fault))
}
