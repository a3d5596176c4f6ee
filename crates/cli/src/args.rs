//! The command line of `roadplane`.

pub mod cameras;
pub mod constraints;
pub mod copy;
pub mod export;
pub mod pieces;
pub mod site;
pub mod stage;
pub mod traffic;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, CommandFactory as _, Parser, Subcommand};
use roadplane_pipeline::Span;
use roadplane_terminal::help::{Group, grouped};
use roadplane_terminal::{CommonArgs, ConfigArgs};

use stage::{ActivityArgs, DetectArgs, KeypointsArgs, SolveArgs, StageArgs, TrackArgs};

/// The commands that `roadplane --help` shows, by group, each with an example.
const GROUPS: &[Group] = &[
    (
        "Track vehicles",
        &[
            ("run", "roadplane run lot.mp4 --out results"),
            ("render", "roadplane render lot.mp4 --run results/lot"),
            ("distance", "roadplane distance results/lot 3 7 --at 12.5"),
        ],
    ),
    (
        "Many clips, long inputs",
        &[
            ("cameras", "roadplane cameras list cameras"),
            ("plan", "roadplane plan day.mp4 --piece-s 3600"),
            ("join", "roadplane join pieces/day.piece-* --out results"),
        ],
    ),
    (
        "Results in other tools",
        &[
            ("traffic", "roadplane traffic results/lot --gates gates.geojson --out counted"),
            ("export", "roadplane export results/lot --format mot,geojson --out exported"),
            ("copy", "roadplane copy results/lot --out scene"),
            ("schemas", "roadplane schemas tracks"),
        ],
    ),
    (
        "Parts and checks",
        &[("stage", "roadplane stage detect lot.mp4 --out boxes.jsonl"), ("doctor", "roadplane doctor")],
    ),
];

/// Metric 3D tracks of vehicles from surveillance video of an uncalibrated camera.
#[derive(Debug, Parser)]
#[command(name = "roadplane", version, about, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub common: CommonArgs,
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

impl Cli {
    /// Returns the command line, with the commands of its help in groups.
    pub fn described() -> clap::Command {
        grouped(Self::command(), GROUPS)
    }
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Track the vehicles of videos: camera, 3D tracks, poses and a report.
    Run(RunArgs),
    /// Draw a finished run into its video.
    Render(RenderArgs),
    /// Measure the distance between two tracks, with its standard deviation.
    Distance(DistanceArgs),
    /// List, show, merge or remove the cameras of a camera database.
    Cameras(cameras::CamerasArgs),
    /// List the pieces in which a long input can be processed.
    Plan(pieces::PlanArgs),
    /// Join the pieces of an input into the result of one run.
    Join(pieces::JoinArgs),
    /// Count vehicles and measure speeds, headways, flows and queues in finished runs.
    Traffic(traffic::TrafficArgs),
    /// Write a finished run in the formats of other tools.
    Export(export::ExportArgs),
    /// Turn a finished run into a scene for simulators.
    Copy(copy::CopyArgs),
    /// Print the JSON schemas of the files in a result.
    Schemas(SchemasArgs),
    /// Run one stage alone: detect, keypoints, solve, track or activity.
    Stage(StageArgs),
    /// Check codecs, runtime and models; say how to mend each fault.
    Doctor(DoctorArgs),

    /// Same as `stage detect`.
    #[command(hide = true)]
    Detect(DetectArgs),
    /// Same as `stage keypoints`.
    #[command(hide = true)]
    Keypoints(KeypointsArgs),
    /// Same as `stage solve`.
    #[command(hide = true)]
    Solve(SolveArgs),
    /// Same as `stage track`.
    #[command(hide = true)]
    Track(TrackArgs),
    /// Same as `stage activity`.
    #[command(hide = true)]
    Activity(ActivityArgs),
    /// Same as `roadplane-lab eval`.
    #[command(hide = true, disable_help_flag = true, disable_version_flag = true)]
    Eval(LabArgs),
    /// Same as `roadplane-lab bench`.
    #[command(hide = true, disable_help_flag = true, disable_version_flag = true)]
    Bench(LabArgs),
    /// Same as `roadplane-lab synth`.
    #[command(hide = true, disable_help_flag = true, disable_version_flag = true)]
    Synth(LabArgs),
    /// Write the manual: a page for each command.
    #[command(hide = true)]
    Man {
        /// Folder for roadplane.1, roadplane-run.1, …; made if it is missing.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Print shell completions.
    #[command(hide = true)]
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

/// Arguments that `roadplane-lab` reads.
#[derive(Debug, Args)]
pub struct LabArgs {
    /// Arguments of the command.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<OsString>,
}

/// Arguments of `roadplane run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Videos, images, folders of images (such a folder is one clip), or folders of videos.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Output folder; each input gets DIR/<name>/, which appears only when it is complete.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: constraints::ConstraintArgs,
    /// Camera database: each clip starts from the earlier estimates of its camera in DIR, and adds its own estimate.
    #[arg(long, value_name = "DIR", requires = "camera_id")]
    pub cameras: Option<PathBuf>,
    /// Camera of the inputs, or a pattern of their file names: {} is the camera, * is anything, for example '{}_*'.
    #[arg(long, value_name = "ID", requires = "cameras")]
    pub camera_id: Option<String>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub site: site::SiteArgs,
    /// Process one piece of a long input: FROM-TO or FROM- in seconds, as `roadplane plan` lists them. The frames go to
    /// DIR/<name>.piece-<from>/ for `roadplane join`.
    #[arg(long, value_name = "FROM-TO", conflicts_with_all = ["cameras", "video", "frames", "background", "focal_px", "tilt_deg",
        "roll_deg", "height_m", "camera", "known", "geo", "camera_at"])]
    pub piece: Option<Span>,
    /// Number of inputs processed at the same time.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: u16,
    /// Continue a stopped run of the same command; skip finished inputs.
    #[arg(long)]
    pub resume: bool,
    /// Replace a finished folder once the new one is complete.
    #[arg(long, conflicts_with = "resume")]
    pub overwrite: bool,
    /// Also write the annotated video DIR/<name>/annotated.mp4.
    #[arg(long)]
    pub video: bool,
    /// Also write frames.jsonl: the boxes, keypoints and camera motion found in each frame.
    #[arg(long)]
    pub frames: bool,
    /// Also write background.png, the scene without moving objects. background.json gives the time at which each part
    /// was last seen empty.
    #[arg(long)]
    pub background: bool,
    /// Frame rate of the images of a folder, 1/s; the same as --set decode.image_fps=F. Without it 30 frames/s are
    /// assumed, and all speeds depend on that rate.
    #[arg(long, value_name = "F")]
    pub image_fps: Option<f64>,
    /// Write counts in Prometheus' text format at the end, for its textfile collector.
    #[arg(long, value_name = "FILE")]
    pub metrics_file: Option<PathBuf>,
    /// Serve the counts of --metrics-file at http://ADDR/metrics while the run lasts; ADDR must be a loopback address,
    /// for example 127.0.0.1:9464.
    #[arg(long, value_name = "ADDR")]
    pub metrics: Option<std::net::SocketAddr>,
    /// Name of this run in JSON log lines and metrics; default: time and process number.
    #[arg(long, value_name = "ID")]
    pub run_id: Option<String>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane distance`.
#[derive(Debug, Args)]
pub struct DistanceArgs {
    /// Folder of the finished run, DIR/<name>.
    pub run: PathBuf,
    /// Number of the first track.
    pub first: u64,
    /// Number of the second track.
    pub second: u64,
    /// Time, s: print the nearest frame only. Default: all frames in which both tracks have a row.
    #[arg(long, value_name = "S")]
    pub at: Option<f64>,
}

/// Arguments of `roadplane schemas`.
#[derive(Debug, Args)]
pub struct SchemasArgs {
    /// One schema only: tracks, camera, poses, frames, summary, known, piece, plan or traffic.
    #[arg(value_name = "NAME")]
    pub name: Option<String>,
    /// Write NAME.schema.json files into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `roadplane render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Input of the run.
    pub input: PathBuf,
    /// Folder of the finished run, DIR/<name>.
    #[arg(long, value_name = "DIR")]
    pub run: PathBuf,
    /// Video to write; default: annotated.mp4 in the run's folder.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
