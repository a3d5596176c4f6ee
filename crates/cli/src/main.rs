//! The `roadplane` binary: parses the command line, runs one command, turns its outcome into an exit code.
//!
//! Contents: `args/` what can be asked, `commands/` a file a command, `logging.rs`, `outcome.rs`, `progress.rs`, `metrics.rs`, `signals.rs`,
//! `sandbox.rs`.
// Doc comments of arguments are their help texts, where <stem> is no tag and [,height_m] no link.
#![allow(rustdoc::invalid_html_tags, rustdoc::broken_intra_doc_links)]

mod args;
mod commands;
mod logging;
mod metrics;
mod outcome;
mod progress;
mod sandbox;
mod signals;

use std::os::unix::process::CommandExt as _;
use std::process::ExitCode;

use clap::Parser as _;
use roadplane_eval::EvalError;
use roadplane_pipeline::{Fault, PipelineError, too_small_address_space};

use args::{Cli, Command};
use outcome::Outcome;

/// All inputs done, but some were damaged or lost.
const DAMAGED: u8 = 3;

fn main() -> ExitCode {
    if let Some(limit_mib) = too_small_address_space() {
        return refuse_to_begin(limit_mib);
    }
    let cli = Cli::parse();
    logging::start(cli.log_format, cli.verbose);
    let cancel = signals::watch();
    let outcome = match &cli.command {
        Command::Run(args) => commands::run::run(args, &cancel),
        Command::Cameras(args) => commands::cameras::cameras(args),
        Command::Render(args) => commands::render::render(args, &cancel),
        Command::Copy(args) => commands::copy::copy(args, &cancel),
        Command::Export(args) => commands::export::export(args),
        Command::Bench(args) => commands::bench::bench(args, &cancel),
        Command::Plan(args) => commands::pieces::plan(args),
        Command::Join(args) => commands::pieces::join(args, &cancel),
        Command::Detect(args) => commands::stages::detect(args, &cancel),
        Command::Keypoints(args) => commands::stages::keypoints(args, &cancel),
        Command::Solve(args) => commands::stages::solve(args, &cancel),
        Command::Schemas(args) => commands::schemas::schemas(args),
        Command::Distance(args) => commands::distance::distance(args),
        Command::Track(args) => commands::stages::track(args, &cancel),
        Command::Activity(args) => commands::stages::activity(args, &cancel),
        Command::Eval(args) => commands::eval::eval(args, &cancel),
        Command::Synth(args) => commands::synth::synth(args, &cancel),
        Command::Doctor(args) => commands::doctor::doctor(args),
        Command::Man { out } => commands::manual(out),
        Command::Completions { shell } => commands::completions(*shell),
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Damaged) => ExitCode::from(DAMAGED),
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{error:#}");
            ExitCode::from(exit_code(&error))
        }
    }
}

/// Says that there is too little address space, without the log, which would need more of it.
fn refuse_to_begin(limit_mib: u64) -> ExitCode {
    eprintln!(
        "error: too little memory: ulimit -v allows {limit_mib} MiB, at least 1.5 GiB are needed: raise it"
    );
    // Some library's clean-up at exit waits for ever for a thread that it had no memory to start: leave without clean-up.
    let _only_where_it_fails = std::process::Command::new("false").exec();
    ExitCode::FAILURE
}

fn exit_code(error: &anyhow::Error) -> u8 {
    let of_eval = || error.downcast_ref::<EvalError>().map(EvalError::fault);
    match error.downcast_ref::<PipelineError>().map(PipelineError::fault).or_else(of_eval) {
        Some(Fault::Usage) => 2,
        Some(Fault::Input) => DAMAGED,
        Some(Fault::Model) => 4,
        Some(Fault::Locked) => 11,
        Some(Fault::Stopped { signal }) => u8::try_from(128 + signal).unwrap_or(1),
        Some(Fault::Internal) | None => 1,
    }
}

/// `roadplane … --out - | head` ends quietly.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<std::io::Error>())
        .any(|io| io.kind() == std::io::ErrorKind::BrokenPipe)
}
