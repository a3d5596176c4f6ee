//! The command line.

pub mod cameras;
pub mod config;
pub mod copy;
pub mod eval;
pub mod export;
pub mod known;
pub mod pieces;
pub mod site;
pub mod synth;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use roadplane_pipeline::Span;

use config::ConfigArgs;

/// Metric 3D tracks of cars from surveillance video of a camera that nobody calibrated.
#[derive(Debug, Parser)]
#[command(name = "roadplane", version, about, propagate_version = true, max_term_width = 110)]
pub struct Cli {
    /// Form of the log on stderr.
    #[arg(long, global = true, value_enum, default_value_t = LogFormat::Text)]
    pub log_format: LogFormat,
    /// Say more (-v: every stage, -vv: every frame).
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Form of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object a line.
    Json,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The main job: video in; camera, 3D tracks, poses and a report out.
    Run(RunArgs),
    /// Lists the pieces in which long inputs are worked on, a JSON line each.
    Plan(pieces::PlanArgs),
    /// Joins the pieces of an input (`run --piece`) to the result of a run over it all.
    Join(pieces::JoinArgs),
    /// Finds vehicles: writes one JSON line a frame.
    Detect(DetectArgs),
    /// Finds the keypoints of given boxes: writes one JSON line a frame.
    Keypoints(KeypointsArgs),
    /// Solves camera, plane, poses and shapes from keypoints alone (no image).
    Solve(SolveArgs),
    /// Tracks from keypoints alone (no image): the right half of `run`.
    Track(TrackArgs),
    /// What is remembered of cameras: lists, shows, merges, forgets.
    Cameras(cameras::CamerasArgs),
    /// Tells what vehicles do, on anybody's tracks on the ground: a label a row, and events.
    Activity(ActivityArgs),
    /// Draws a finished run into a video.
    Render(RenderArgs),
    /// Makes a finished run a scene that plays in simulators: OpenSCENARIO, OpenDRIVE, glTF.
    Copy(copy::CopyArgs),
    /// Writes a finished run in the formats of others.
    Export(export::ExportArgs),
    /// Measures: nets, solver, finished runs, against truth; prints tables.
    Eval(eval::EvalArgs),
    /// How far two tracks of a finished run are from each other, with its sd: errors that they share cancel.
    Distance(DistanceArgs),
    /// Makes data sets of geometry alone: truth, and measured keypoints for `solve`.
    Synth(synth::SynthArgs),
    /// Prints the JSON schemas of the files that a run leaves, or writes them into a folder.
    Schemas(SchemasArgs),
    /// Measures what the main job costs on an input: prints one table.
    Bench(BenchArgs),
    /// Checks codecs, runtime, models, and says what to do about what is missing.
    Doctor(DoctorArgs),
    /// Writes the manual: a page for every command.
    Man {
        /// Folder for roadplane.1, roadplane-run.1, …; made where it is missing.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Prints shell completions.
    Completions {
        /// For which shell.
        shell: clap_complete::Shell,
    },
}

/// `roadplane run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Videos, images, or folders of images (a folder is one clip).
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Each input gets a folder DIR/<stem>/, complete or not there at all.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub known: known::KnownArgs,
    /// Remembers cameras in DIR: each clip starts from what other clips said of its camera before this command, and adds what it
    /// says itself.
    #[arg(long, value_name = "DIR", requires = "camera_id")]
    pub cameras: Option<PathBuf>,
    /// The inputs' camera; or a pattern of their names in which {} is the camera and * anything, e.g. '{}_*'.
    #[arg(long, value_name = "ID", requires = "cameras")]
    pub camera_id: Option<String>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub site: site::SiteArgs,
    /// Works on one piece of a long input only, FROM-TO or FROM- in seconds as `roadplane plan` lists them: the frames go to
    /// DIR/<stem>.piece-<from>/, which `roadplane join` needs.
    #[arg(long, value_name = "FROM-TO", conflicts_with_all = ["cameras", "video", "frames", "background", "focal_px", "tilt_deg",
        "roll_deg", "height_m", "camera", "known", "geo", "camera_at"])]
    pub piece: Option<Span>,
    /// Inputs worked on at the same time.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: u16,
    /// Goes on where a stopped run of the same command ended; finished inputs are left alone.
    #[arg(long)]
    pub resume: bool,
    /// Replaces finished folders (once the new one is complete).
    #[arg(long, conflicts_with = "resume")]
    pub overwrite: bool,
    /// Also writes the annotated video DIR/<stem>/annotated.mp4.
    #[arg(long)]
    pub video: bool,
    /// Also leaves frames.jsonl in the result: what watching, detector and keypoint net found in each frame.
    #[arg(long)]
    pub frames: bool,
    /// Also writes the place without what moves: DIR/<stem>/background.png, and background.json with when each part of it was
    /// last seen bare.
    #[arg(long)]
    pub background: bool,
    /// Writes counts in Prometheus' text format at the end, for its textfile collector.
    #[arg(long, value_name = "FILE")]
    pub metrics_file: Option<PathBuf>,
    /// Serves the same while running, http://ADDR/metrics; ADDR is of this machine alone, e.g. 127.0.0.1:9464.
    #[arg(long, value_name = "ADDR")]
    pub metrics: Option<std::net::SocketAddr>,
    /// Names this run in JSON log lines and metrics; default: time and process.
    #[arg(long, value_name = "ID")]
    pub run_id: Option<String>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
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
    pub known: known::KnownArgs,
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
    pub known: known::KnownArgs,
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

/// `roadplane distance`.
#[derive(Debug, Args)]
pub struct DistanceArgs {
    /// Folder of the finished run, DIR/<stem>.
    pub run: PathBuf,
    /// Number of one track.
    pub first: u64,
    /// Number of the other.
    pub second: u64,
    /// Only the frame nearest to this time, s; otherwise all frames in which both have a row.
    #[arg(long, value_name = "S")]
    pub at: Option<f64>,
}

/// `roadplane schemas`.
#[derive(Debug, Args)]
pub struct SchemasArgs {
    /// Only of this file: tracks, camera, poses, frames, summary, known, piece or plan.
    #[arg(value_name = "NAME")]
    pub name: Option<String>,
    /// Writes NAME.schema.json files into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// `roadplane render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// The input of the run.
    pub input: PathBuf,
    /// Folder of the finished run, DIR/<stem>.
    #[arg(long, value_name = "DIR")]
    pub run: PathBuf,
    /// Video to write; default: annotated.mp4 in the run's folder.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Video, image, or folder of images.
    pub input: PathBuf,
    /// Also measures the run that looks at everything (watch.attention=false).
    #[arg(long)]
    pub full: bool,
    /// Prints one JSON object instead of the table.
    #[arg(long)]
    pub json: bool,
    /// Keeps the runs' results in DIR/<attention or full>/<stem>/; default: a folder here that is removed at the end.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}
