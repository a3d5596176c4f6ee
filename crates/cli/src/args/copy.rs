//! Arguments of `roadplane copy`.

use std::path::PathBuf;

use clap::Args;

use roadplane_terminal::ConfigArgs;

/// Arguments of `roadplane copy`.
#[derive(Debug, Args)]
pub struct CopyArgs {
    /// Folder of the finished run, DIR/<name>.
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Output folder; it appears only when it is complete.
    #[arg(long, value_name = "SCENE")]
    pub out: PathBuf,
    /// Input of the run, for the vehicles' colours; default: the path stored in the run.
    #[arg(long, value_name = "INPUT")]
    pub input: Option<PathBuf>,
    /// Replace a finished scene once the new one is complete.
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
