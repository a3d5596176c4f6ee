//! Arguments of `roadplane copy`.

use std::path::PathBuf;

use clap::Args;

use roadplane_terminal::ConfigArgs;

/// `roadplane copy`.
#[derive(Debug, Args)]
pub struct CopyArgs {
    /// Folder of the finished run, DIR/<stem>.
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Folder to write, complete or not there at all.
    #[arg(long, value_name = "SCENE")]
    pub out: PathBuf,
    /// The run's input, for the vehicles' colours; default: where the run says that it was.
    #[arg(long, value_name = "INPUT")]
    pub input: Option<PathBuf>,
    /// Replaces a finished scene (once the new one is complete).
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
