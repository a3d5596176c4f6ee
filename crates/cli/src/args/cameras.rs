//! `roadplane cameras …`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// `roadplane cameras`.
#[derive(Debug, Args)]
pub struct CamerasArgs {
    /// What to do.
    #[command(subcommand)]
    pub what: CamerasCommand,
}

/// What to do with remembered cameras.
#[derive(Debug, Subcommand)]
pub enum CamerasCommand {
    /// One line a camera: clips, focal length, height, tilt as they are known now.
    List(CamerasListArgs),
    /// Every epoch of one camera, with its clips.
    Show(CamerasShowArgs),
    /// Joins folders of remembered cameras, and results of runs, into one: the same bytes in any order.
    Merge(CamerasMergeArgs),
    /// Forgets a camera.
    Forget(CamerasForgetArgs),
}

/// `roadplane cameras list`.
#[derive(Debug, Args)]
pub struct CamerasListArgs {
    /// Folder of the remembered cameras, as in `run --cameras`.
    pub folder: PathBuf,
    /// Prints one JSON object a camera.
    #[arg(long)]
    pub json: bool,
}

/// `roadplane cameras show`.
#[derive(Debug, Args)]
pub struct CamerasShowArgs {
    /// Folder of the remembered cameras, as in `run --cameras`.
    pub folder: PathBuf,
    /// The camera.
    pub camera: String,
    /// Prints one JSON object an epoch.
    #[arg(long)]
    pub json: bool,
}

/// `roadplane cameras merge`.
#[derive(Debug, Args)]
pub struct CamerasMergeArgs {
    /// Folders of remembered cameras, or output folders of runs.
    #[arg(required = true, value_name = "DIR")]
    pub from: Vec<PathBuf>,
    /// Folder that gets what all of them know; what it knows already stays.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// `roadplane cameras forget`.
#[derive(Debug, Args)]
pub struct CamerasForgetArgs {
    /// Folder of the remembered cameras, as in `run --cameras`.
    pub folder: PathBuf,
    /// The camera.
    pub camera: String,
}
