//! Arguments of `roadplane stage`: the stages of a run, each alone.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use roadplane_terminal::ConfigArgs;

use super::constraints::ConstraintArgs;

/// Arguments of `roadplane stage`.
#[derive(Debug, Args)]
pub struct StageArgs {
    /// The stage.
    #[command(subcommand)]
    pub stage: Stage,
}

/// The stages.
#[derive(Debug, Subcommand)]
pub enum Stage {
    /// Detect vehicles; write one JSON line per frame.
    Detect(DetectArgs),
    /// Find the keypoints in given boxes; write one JSON line per frame.
    Keypoints(KeypointsArgs),
    /// Solve camera, plane, poses and shapes from keypoints alone, without images.
    Solve(SolveArgs),
    /// Track vehicles from keypoints alone, without images: the estimation half of `run`.
    Track(TrackArgs),
    /// Label the activities of any ground-plane tracks: a label per row, and events.
    Activity(ActivityArgs),
}

/// Arguments of `roadplane stage detect`.
#[derive(Debug, Args)]
pub struct DetectArgs {
    /// Video, image, or folder of images.
    pub input: PathBuf,
    /// Output file, `-` for standard output.
    #[arg(long, value_name = "F.jsonl")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane stage keypoints`.
#[derive(Debug, Args)]
pub struct KeypointsArgs {
    /// Video, image, or folder of images.
    pub input: PathBuf,
    /// Frames with boxes, as `roadplane stage detect` writes them.
    #[arg(long, value_name = "F.jsonl")]
    pub boxes: PathBuf,
    /// Output file, `-` for standard output.
    #[arg(long, value_name = "G.jsonl")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane stage solve`.
#[derive(Debug, Args)]
pub struct SolveArgs {
    /// Frames with keypoints, as `roadplane stage keypoints` writes them.
    pub frames: PathBuf,
    /// File for the poses; camera.json is written beside it.
    #[arg(long, value_name = "P.jsonl")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: ConstraintArgs,
    /// Method of the solver.
    #[arg(long, value_enum, default_value_t = MethodArg::Joint)]
    pub method: MethodArg,
    /// Do not put the cars on one plane: solve each pose in six degrees of freedom.
    #[arg(long)]
    pub no_plane: bool,
    /// Solve each frame alone instead of one camera for the clip.
    #[arg(long)]
    pub per_frame: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Methods of solving frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodArg {
    /// One camera for the clip, with all cars on its plane.
    Joint,
    /// Algorithm 1 of the paper (Car Pose in Context), on each frame alone.
    Paper,
}

/// Arguments of `roadplane stage track`.
#[derive(Debug, Args)]
pub struct TrackArgs {
    /// Frames with keypoints, as `roadplane stage keypoints` or `roadplane run --frames` writes them.
    pub frames: PathBuf,
    /// Output folder with the files of a run: camera.json, poses.jsonl, tracks.*, summary.json.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: ConstraintArgs,
    /// Replace a finished folder once the new one is complete.
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane stage activity`.
#[derive(Debug, Args)]
pub struct ActivityArgs {
    /// Tracks (.parquet, .csv, .jsonl) with columns time_s, track, x_m, y_m; optional: heading_rad, x_sd_m, y_sd_m,
    /// x_own_sd_m, y_own_sd_m, observed.
    pub tracks: PathBuf,
    /// File for the rows with activity and activity_p; events go to FILE.activities.jsonl beside it.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
