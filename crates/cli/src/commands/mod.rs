//! One file a command; each turns arguments into a call of `pipeline` and prints what came of it.

use std::io::stdout;

use clap::CommandFactory as _;
use roadplane_pipeline::{Config, PipelineError};

use crate::Outcome;
use crate::args::{Cli, ConfigArgs};

pub mod bench;
pub mod copy;
pub mod doctor;
pub mod eval;
pub mod export;
pub mod render;
pub mod run;
pub mod stages;
pub mod synth;

/// Prints completions for a shell.
pub fn completions(shell: clap_complete::Shell) -> anyhow::Result<Outcome> {
    clap_complete::generate(shell, &mut Cli::command(), "roadplane", &mut stdout().lock());
    Ok(Outcome::Done)
}

/// The configuration that the arguments ask for.
fn config(args: &ConfigArgs) -> Result<Config, PipelineError> {
    Config::load(args.config.as_deref(), &args.settings).map_err(PipelineError::from)
}
