//! The command line of the laboratory.

pub mod bench;
pub mod eval;
pub mod synth;

use std::path::PathBuf;

use clap::{CommandFactory as _, Parser, Subcommand};
use roadplane_terminal::CommonArgs;
use roadplane_terminal::help::{Group, grouped};

/// The commands that `roadplane-lab --help` shows, each with an example.
const GROUPS: &[Group] = &[(
    "Commands",
    &[
        ("eval", "roadplane-lab eval dataset tests/data/lots"),
        ("bench", "roadplane-lab bench lot.mp4 --full"),
        ("synth", "roadplane-lab synth --out scenes --stills 100 --clips 5"),
    ],
)];

/// The laboratory of roadplane: evaluations against truth, benchmarks, synthetic data sets.
#[derive(Debug, Parser)]
#[command(name = "roadplane-lab", version, about, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub common: CommonArgs,
    /// The command to run.
    #[command(subcommand)]
    pub command: Command,
}

impl Cli {
    /// Returns the command line with its grouped help.
    pub fn described() -> clap::Command {
        grouped(Self::command(), GROUPS)
    }
}

/// The commands of `roadplane-lab`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Evaluate nets, the solver, the tracker or finished runs against truth.
    Eval(eval::EvalArgs),
    /// Measure the cost of a run on one input, by stage.
    Bench(bench::BenchArgs),
    /// Make synthetic data sets without pictures: truth, and noisy keypoints for the solver.
    Synth(synth::SynthArgs),
    /// Write the manual pages, one for each command.
    #[command(hide = true)]
    Man {
        /// Folder for the pages roadplane-lab.1, roadplane-lab-eval.1, …; the folder is made if it is missing.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Print shell completions.
    #[command(hide = true)]
    Completions {
        /// The shell that gets the completions.
        shell: clap_complete::Shell,
    },
}
