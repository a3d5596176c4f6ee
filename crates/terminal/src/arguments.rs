//! Arguments that every command takes.

use clap::{Args, ValueEnum};
use roadplane_pipeline::Cancel;

use crate::{logging, signals};

/// Display order of these arguments in the help: after the command's own arguments.
const LAST: usize = 1000;

/// Arguments that every command takes.
#[derive(Debug, Args)]
pub struct CommonArgs {
    /// Form of the log on stderr: text for people, json for programs (one object per line).
    #[arg(long, global = true, value_enum, default_value_t = LogFormat::Text, hide_possible_values = true, display_order = LAST)]
    pub log_format: LogFormat,
    /// Log more (-v: every stage, -vv: every frame).
    #[arg(short, long, global = true, action = clap::ArgAction::Count, display_order = LAST)]
    pub verbose: u8,
}

impl CommonArgs {
    /// Starts the log and the signal handlers. Returns the flag by which a signal asks the program to stop.
    #[must_use]
    pub fn start(&self) -> Cancel {
        logging::start(self.log_format, self.verbose);
        signals::watch()
    }
}

/// Format of the log on stderr.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines of text for people to read.
    Text,
    /// One JSON object per line, for programs to read.
    Json,
}
