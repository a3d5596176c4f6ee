//! Arguments of `roadplane-lab bench`.

use std::path::PathBuf;

use clap::Args;
use roadplane_terminal::ConfigArgs;

/// Arguments of `roadplane-lab bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Video, image, or folder of images.
    pub input: PathBuf,
    /// Also measure a run that scans every frame in full (`watch.attention=false`).
    #[arg(long)]
    pub full: bool,
    /// Print one JSON object instead of the table.
    #[arg(long)]
    pub json: bool,
    /// Keep the runs' results in `DIR/attention/<name>/` and `DIR/full/<name>/`; default: a temporary folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
