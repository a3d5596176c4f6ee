//! Arguments of `roadplane stage`: the stages of a run, each alone.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use roadplane_terminal::ConfigArgs;

use super::constraints::ConstraintArgs;

/// `roadplane stage`.
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

/// `roadplane detect`.
#[derive(Debug, Args)]
pub struct DetectArgs {
    /// Video, image, or folder of images.
    pub input: PathBuf,
    /// File to write, `-` for standard output.
    #[arg(long, value_name = "F.jsonl")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane keypoints`.
#[derive(Debug, Args)]
pub struct KeypointsArgs {
    /// Video, image, or folder of images.
    pub input: PathBuf,
    /// Frames with boxes, as `roadplane detect` writes them.
    #[arg(long, value_name = "F.jsonl")]
    pub boxes: PathBuf,
    /// File to write, `-` for standard output.
    #[arg(long, value_name = "G.jsonl")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane solve`.
#[derive(Debug, Args)]
pub struct SolveArgs {
    /// Frames with keypoints, as `roadplane keypoints` writes them.
    pub frames: PathBuf,
    /// Poses to write; camera.json goes beside it.
    #[arg(long, value_name = "P.jsonl")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: ConstraintArgs,
    /// joint: one camera for the clip, cars stand on its plane. paper: each frame by itself, free cars drawn to a plane by the
    /// paper's Algorithm 1.
    #[arg(long, value_enum, default_value_t = MethodArg::Joint)]
    pub method: MethodArg,
    /// Leaves every car free in six degrees of freedom.
    #[arg(long)]
    pub no_plane: bool,
    /// Solves each frame on its own instead of one camera for the clip.
    #[arg(long)]
    pub per_frame: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Ways of solving frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodArg {
    /// One model of camera and cars.
    Joint,
    /// The paper's alternation.
    Paper,
}

/// `roadplane track`.
#[derive(Debug, Args)]
pub struct TrackArgs {
    /// Frames with keypoints, as `roadplane keypoints` writes them and `roadplane run --frames` leaves them.
    pub frames: PathBuf,
    /// Folder to write, as a run leaves it: camera.json, poses.jsonl, tracks.*, summary.json.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: ConstraintArgs,
    /// Replaces a finished folder (once the new one is complete).
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane activity`.
#[derive(Debug, Args)]
pub struct ActivityArgs {
    /// Tracks (.parquet, .csv, .jsonl): columns time_s, track, x_m, y_m; heading_rad, x_sd_m, y_sd_m, observed
    /// where they are known.
    pub tracks: PathBuf,
    /// The rows with activity and activity_p; the events go beside it, FILE.activities.jsonl.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
