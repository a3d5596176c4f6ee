//! Arguments of `roadplane plan`, `roadplane join`.

use std::path::PathBuf;

use clap::Args;

use roadplane_terminal::ConfigArgs;

/// Arguments of `roadplane plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// Videos, images, or folders of images.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Length of a piece, s; a multiple of 60.
    #[arg(long, default_value_t = 3600, value_name = "S")]
    pub piece_s: u64,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane join`.
#[derive(Debug, Args)]
pub struct JoinArgs {
    /// Folders of all pieces of one input, in any order.
    #[arg(required = true, value_name = "PIECE")]
    pub pieces: Vec<PathBuf>,
    /// Output folder; the input gets DIR/<name>/, which appears only when it is complete.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: super::constraints::ConstraintArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub site: super::site::SiteArgs,
    /// Camera database, as in `run`.
    #[arg(long, value_name = "DIR", requires = "camera_id")]
    pub cameras: Option<PathBuf>,
    /// Camera of the input, or a pattern of its file name, as in `run`.
    #[arg(long, value_name = "ID", requires = "cameras")]
    pub camera_id: Option<String>,
    /// Skip a finished folder.
    #[arg(long)]
    pub resume: bool,
    /// Replace a finished folder once the new one is complete.
    #[arg(long, conflicts_with = "resume")]
    pub overwrite: bool,
    /// Also write frames.jsonl into the result.
    #[arg(long)]
    pub frames: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
