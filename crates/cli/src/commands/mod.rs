//! One file a command; each turns arguments into a call of `pipeline` and prints what came of it.

use std::io::stdout;
use std::path::Path;

use anyhow::Context as _;
use clap::CommandFactory as _;

use crate::args::Cli;
use crate::outcome::Outcome;

pub mod bench;
pub mod cameras;
mod config;
pub mod copy;
pub mod distance;
pub mod doctor;
pub mod eval;
pub mod export;
pub mod pieces;
pub mod render;
pub mod run;
pub mod schemas;
pub mod site;
pub mod stages;
pub mod synth;

/// Prints completions for a shell.
pub fn completions(shell: clap_complete::Shell) -> anyhow::Result<Outcome> {
    clap_complete::generate(shell, &mut Cli::command(), "roadplane", &mut stdout().lock());
    Ok(Outcome::Done)
}

/// Writes the manual.
pub fn manual(out: &Path) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    clap_mangen::generate_to(Cli::command(), out)
        .with_context(|| format!("the manual cannot be written to {}", out.display()))?;
    Ok(Outcome::Done)
}
