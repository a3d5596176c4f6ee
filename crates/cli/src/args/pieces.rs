//! `roadplane plan`, `roadplane join`.

use std::path::PathBuf;

use clap::Args;

use roadplane_terminal::ConfigArgs;

/// `roadplane plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// Videos, images, or folders of images.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Length of a piece, s: a multiple of 60.
    #[arg(long, default_value_t = 3600, value_name = "S")]
    pub piece_s: u64,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane join`.
#[derive(Debug, Args)]
pub struct JoinArgs {
    /// Folders of all pieces of one input, in any order.
    #[arg(required = true, value_name = "PIECE")]
    pub pieces: Vec<PathBuf>,
    /// The input gets a folder DIR/<stem>/, complete or not there at all.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: super::constraints::ConstraintArgs,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub site: super::site::SiteArgs,
    /// Remembers cameras in DIR, as in `run`.
    #[arg(long, value_name = "DIR", requires = "camera_id")]
    pub cameras: Option<PathBuf>,
    /// The input's camera, or a pattern of its name, as in `run`.
    #[arg(long, value_name = "ID", requires = "cameras")]
    pub camera_id: Option<String>,
    /// Leaves a finished folder alone.
    #[arg(long)]
    pub resume: bool,
    /// Replaces a finished folder (once the new one is complete).
    #[arg(long, conflicts_with = "resume")]
    pub overwrite: bool,
    /// Also leaves frames.jsonl in the result.
    #[arg(long)]
    pub frames: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
