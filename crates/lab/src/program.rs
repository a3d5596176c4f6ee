//! The program `roadplane-lab`: parses the command line, runs one command, and turns the outcome into an exit code.

use std::process::ExitCode;

use clap::FromArgMatches as _;
use roadplane_metrics::MetricsError;
use roadplane_pipeline::PipelineError;
use roadplane_terminal::{exit_code, help, refuse_small_address_space};

use crate::args::{Cli, Command};
use crate::{LabError, commands};

/// Runs the program with the arguments of this process and returns the exit code.
#[must_use]
pub fn run_program() -> ExitCode {
    if let Some(refused) = refuse_small_address_space() {
        return refused;
    }
    let cli = Cli::from_arg_matches(&Cli::described().get_matches()).unwrap_or_else(|error| error.exit());
    let cancel = cli.common.start();
    let outcome = match &cli.command {
        Command::Eval(args) => commands::eval::eval(args, &cancel),
        Command::Bench(args) => commands::bench::bench(args, &cancel),
        Command::Synth(args) => commands::synth::synth(args, &cancel),
        Command::Man { out } => help::manual(Cli::described(), out),
        Command::Completions { shell } => help::completions(Cli::described(), *shell),
    };
    exit_code(outcome, |error| {
        let pipeline = error.downcast_ref::<PipelineError>().map(PipelineError::fault);
        let lab = || error.downcast_ref::<LabError>().map(LabError::fault);
        let metrics = || error.downcast_ref::<MetricsError>().map(LabError::fault_of_metrics);
        pipeline.or_else(lab).or_else(metrics)
    })
}
