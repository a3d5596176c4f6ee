//! Arguments of `roadplane cameras`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Arguments of `roadplane cameras`.
#[derive(Debug, Args)]
pub struct CamerasArgs {
    /// The operation.
    #[command(subcommand)]
    pub operation: CamerasCommand,
}

/// Operations on a camera database.
#[derive(Debug, Subcommand)]
pub enum CamerasCommand {
    /// Print one line per camera: clips, focal length, height and tilt by its latest estimate.
    List(CamerasListArgs),
    /// Print every epoch of one camera, with its clips; an epoch ends when the camera is moved.
    Show(CamerasShowArgs),
    /// Merge camera databases and results of runs into one database; the order of the inputs does not matter.
    Merge(CamerasMergeArgs),
    /// Remove a camera from a database.
    Forget(CamerasForgetArgs),
}

/// Arguments of `roadplane cameras list`.
#[derive(Debug, Args)]
pub struct CamerasListArgs {
    /// Folder of the camera database, as in `run --cameras`.
    pub folder: PathBuf,
    /// Print one JSON object per camera.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `roadplane cameras show`.
#[derive(Debug, Args)]
pub struct CamerasShowArgs {
    /// Folder of the camera database, as in `run --cameras`.
    pub folder: PathBuf,
    /// Name of the camera.
    pub camera: String,
    /// Print one JSON object per epoch.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `roadplane cameras merge`.
#[derive(Debug, Args)]
pub struct CamerasMergeArgs {
    /// Camera databases, or output folders of runs.
    #[arg(required = true, value_name = "DIR")]
    pub from: Vec<PathBuf>,
    /// Folder of the merged database; clips already in it stay.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Arguments of `roadplane cameras forget`.
#[derive(Debug, Args)]
pub struct CamerasForgetArgs {
    /// Folder of the camera database, as in `run --cameras`.
    pub folder: PathBuf,
    /// Name of the camera.
    pub camera: String,
}
