//! Arguments of `roadplane-lab eval`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use roadplane_terminal::ConfigArgs;

use crate::Motion;

/// Arguments of `roadplane-lab eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// The evaluation to run.
    #[command(subcommand)]
    pub command: EvalCommand,
}

/// The evaluations, one for each subcommand of `roadplane-lab eval`.
#[derive(Debug, Subcommand)]
pub enum EvalCommand {
    /// Evaluate a finished run against truth: camera, tracks, poses, boxes.
    #[command(after_help = "Example:\n  roadplane-lab eval run results/lot --truth lot.truth.json")]
    Run(EvalRunArgs),
    /// Evaluate six systems on the same keypoints of a data set with truth (Tables 1 and 2 of the paper Car Pose in
    /// Context).
    #[command(after_help = "Example:\n  roadplane-lab eval dataset tests/data/lots --part 0.1 --out tables")]
    Dataset(EvalDatasetArgs),
    /// Evaluate region-of-interest scheduling: compare runs with and without scheduling, and score both if a clip has
    /// truth.
    #[command(
        alias = "attention",
        after_help = "Example:\n  roadplane-lab eval regions lot.mp4 road.mp4 --out tables"
    )]
    Regions(EvalRegionsArgs),
    /// Evaluate moving cameras: film each clip with a camera that turns or zooms, and compare with the clip at rest;
    /// score rendered clips with turning cameras against truth.
    #[command(
        after_help = "Example:\n  roadplane-lab eval motion road.mp4 --set decode.start_s=10 --focal-px 600 --out tables"
    )]
    Motion(EvalMotionArgs),
    /// Evaluate speeds of finished runs: against times between two gates of known distance, or against truth.
    #[command(
        after_help = "Examples:\n  roadplane-lab eval speeds results/road --passings measured.csv --traffic counted\n  roadplane-lab eval speeds \
                      results/lot --truth lot.truth.json"
    )]
    Speeds(EvalSpeedsArgs),
    /// Evaluate activities from 2D motion, 3D motion and pixels against truth (Table 4 of the paper Car Pose in
    /// Context).
    #[command(after_help = "Example:\n  roadplane-lab eval activity tests/data/lots")]
    Activity(EvalActivityArgs),
    /// Evaluate five systems on your own copy of the KITTI object benchmark (Table 3 of the paper Car Pose in Context).
    ///
    /// Only images with more than three vehicles are evaluated.
    #[command(after_help = "Example:\n  roadplane-lab eval kitti KITTI/object --part 0.1")]
    Kitti(EvalKittiArgs),
    /// Evaluate tracks of boxes in MOT Challenge files or KITTI tracking labels: HOTA, MOTA, IDF1.
    #[command(after_help = "Example:\n  roadplane-lab eval tracks exported/mot/lot.txt --truth gt.txt")]
    Tracks(EvalFilesArgs),
    /// Evaluate the tracker alone on simulated measurements of clips with truth: misses, false boxes, wrong labels.
    #[command(after_help = "Example:\n  roadplane-lab eval tracker lot.truth.json --misses 0.2")]
    Tracker(EvalTrackerArgs),
    /// Evaluate detections in a COCO file against the true boxes in a second COCO file: average precision by size.
    #[command(after_help = "Example:\n  roadplane-lab eval boxes found.json --truth instances.json")]
    Boxes(EvalFilesArgs),
    /// Evaluate the detector on pictures with true boxes: average precision, false boxes, and vehicles found by size,
    /// class, camera and weather; draw the worst pictures.
    #[command(
        after_help = "Example:\n  roadplane-lab eval detector boxes.json FOLDER --format f32,int8 --out tables"
    )]
    Detector(EvalDetectorArgs),
    /// Evaluate the keypoint network on labelled images: errors per keypoint, size and body type; draw the worst cars.
    #[command(after_help = "Example:\n  roadplane-lab eval keypoints --truth labels.json --images DIR")]
    Keypoints(EvalKeypointsArgs),
    /// Evaluate the joint solver on synthetic scenes: accuracy against the Cramér–Rao bound, calibration, speed.
    #[command(after_help = "Example:\n  roadplane-lab eval solver --scenes 50 --out tables")]
    Solver(EvalSolverArgs),
    /// Evaluate the estimated cameras against reference cameras (cameras.json, or a rendered data set), by car and by
    /// keypoint.
    #[command(after_help = "Example:\n  roadplane-lab eval cameras FOLDER --out tables")]
    Cameras(EvalCamerasArgs),
    /// Evaluate stored cameras on synthetic clips: error, bound and sd after 1, 3, 10 and 30 nights.
    #[command(
        alias = "remembered",
        after_help = "Example:\n  roadplane-lab eval camera-database --cameras 50 --clips 10"
    )]
    CameraDatabase(EvalCameraDatabaseArgs),
}

/// Arguments of `roadplane-lab eval run`.
#[derive(Debug, Args)]
pub struct EvalRunArgs {
    /// Folder of the finished run, DIR/<name>.
    pub run: PathBuf,
    /// Truth file (roadplane.truth/1), calibrated camera (.krtd), vehicles tracked by other sensors (.vehicles.json),
    /// or boxes (KPF, geom.yml with types.yml beside it).
    #[arg(long, value_name = "FILE")]
    pub truth: PathBuf,
    /// Write the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `roadplane-lab eval speeds`.
#[derive(Debug, Args)]
pub struct EvalSpeedsArgs {
    /// Folders of finished runs, DIR/<name>.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// CSV files of measured passings, one for each run: from_gate, to_gate, distance_m, from_s, to_s. The gates are
    /// those of roadplane traffic RUN --gates FILE --out DIR.
    #[arg(
        long,
        value_name = "FILE",
        num_args = 1..,
        required_unless_present = "truth",
        conflicts_with = "truth"
    )]
    pub passings: Vec<PathBuf>,
    /// With --passings: output folder of roadplane traffic; by default, the folder traffic of each run.
    #[arg(long, value_name = "DIR", conflicts_with = "truth")]
    pub traffic: Option<PathBuf>,
    /// Truth files (roadplane.truth/1), one for each run.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub truth: Vec<PathBuf>,
    /// With --truth: length of the pieces of path over which the speed is compared, m.
    #[arg(long, value_name = "M", default_value_t = 20.0)]
    pub distance_m: f64,
    /// Write the table as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `roadplane-lab eval regions`.
#[derive(Debug, Args)]
pub struct EvalRegionsArgs {
    /// Videos; a file NAME.truth.json(.gz) beside NAME.mp4 holds the truth of that video.
    #[arg(required = true, value_name = "CLIP")]
    pub clips: Vec<PathBuf>,
    /// Write the table as CSV and HTML into this folder, and the results of all runs into its subfolder runs.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane-lab eval motion`.
#[derive(Debug, Args)]
pub struct EvalMotionArgs {
    /// Videos of cameras at rest, or folders of clips by `roadplane-train render turning`.
    #[arg(required = true, value_name = "CLIP")]
    pub inputs: Vec<PathBuf>,
    /// Length of the films, s.
    #[arg(long, default_value_t = 12.0, value_name = "S", value_parser = positive)]
    pub seconds: f64,
    /// Focal length of the videos, px; by default, the estimate of the run at rest.
    #[arg(long, value_name = "PX", value_parser = positive)]
    pub focal_px: Option<f64>,
    /// Give the focal length to all runs on videos, so that they differ by the motion alone.
    #[arg(long, requires = "focal_px")]
    pub given_focal: bool,
    /// Mirror the videos; the motions have other phases and directions.
    #[arg(long)]
    pub mirrored: bool,
    /// Motions with which the videos are filmed. The last two need a width of 1280 px.
    #[arg(
        long,
        num_args = 1..,
        value_name = "MOTION",
        default_values = [
            "aside", "sway_3px", "sway_12px", "shake_8hz", "drift", "pan", "zoom", "far_pan", "tour",
        ]
    )]
    pub motions: Vec<Motion>,
    /// Film the videos through a lens with this distortion at half the picture's width (division model): -0.05 is a
    /// barrel distortion.
    #[arg(long, value_name = "D", default_value_t = 0.0, allow_negative_numbers = true)]
    pub distortion: f64,
    /// Write the tables as CSV and HTML into this folder, and the films and runs into its subfolders.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Keypoints that the systems get.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Keypoints {
    /// Keypoints of our network, in the true boxes.
    Net,
    /// True keypoints with noise.
    Noise,
    /// Both kinds, each in its own tables.
    Both,
}

/// Arguments of `roadplane-lab eval dataset`.
#[derive(Debug, Args)]
pub struct EvalDatasetArgs {
    /// Folder with dataset.json.
    pub folder: PathBuf,
    /// Keypoints that the systems get.
    #[arg(long, value_enum, default_value_t = Keypoints::Both)]
    pub keypoints: Keypoints,
    /// Standard deviation of the noise on true keypoints, as a share of the box's longer side.
    #[arg(long, default_value_t = 0.02, value_name = "SHARE", value_parser = share)]
    pub noise: f64,
    /// Share of the items to evaluate; 0.1 means every tenth item.
    #[arg(long, default_value_t = 1.0, value_name = "SHARE", value_parser = share)]
    pub part: f64,
    /// Process every n-th frame of a clip.
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub stride: u32,
    /// Also evaluate the real stills in this folder; NAME.krtd beside a still NAME.png or NAME.jpg is its calibrated
    /// camera.
    #[arg(long, value_name = "DIR")]
    pub real: Option<PathBuf>,
    /// Write the tables as CSV and HTML, and the runs of the clips, into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_not_a_number| "must be a number".to_owned())
}

fn width(text: &str) -> Result<f64, String> {
    let width = number(text)?;
    if width.is_finite() && width >= 0.0 { Ok(width) } else { Err("must not be negative".to_owned()) }
}

fn positive(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("must be positive".to_owned()) }
}

fn share(text: &str) -> Result<f64, String> {
    let share = number(text)?;
    if (0.0..=1.0).contains(&share) { Ok(share) } else { Err("must lie between 0 and 1".to_owned()) }
}

/// Arguments of `roadplane-lab eval activity`.
#[derive(Debug, Args)]
pub struct EvalActivityArgs {
    /// Folder with dataset.json, whose clips are run and scored per frame; or a table of labelled instances (.parquet,
    /// .csv, .jsonl) from `roadplane-train activity meva`.
    pub data: PathBuf,
    /// Write the tables as CSV and HTML into this folder, and the runs of the clips into its subfolder runs; finished
    /// runs are reused.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane-lab eval kitti`.
#[derive(Debug, Args)]
pub struct EvalKittiArgs {
    /// Folder with image_2, label_2 and calib, or with these in training/.
    pub folder: PathBuf,
    /// Share of the images to evaluate; 0.1 means every tenth image.
    #[arg(long, default_value_t = 1.0, value_name = "P")]
    pub part: f64,
    /// Write the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane-lab eval tracks` and `roadplane-lab eval boxes`.
#[derive(Debug, Args)]
pub struct EvalFilesArgs {
    /// File to evaluate.
    pub found: PathBuf,
    /// Ground-truth file.
    #[arg(long, value_name = "FILE")]
    pub truth: PathBuf,
    /// Write the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `roadplane-lab eval tracker`.
#[derive(Debug, Args)]
pub struct EvalTrackerArgs {
    /// Truth files of clips (NAME.truth.json, gzipped or not; no video is needed), or folders with dataset.json.
    #[arg(required = true, value_name = "CLIP")]
    pub clips: Vec<PathBuf>,
    /// Use the frames that a run recorded (DIR/NAME/frames.jsonl), and simulate none.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["noise", "misses", "false_boxes", "flips", "swaps", "stride", "seed"])]
    pub recorded: Option<PathBuf>,
    /// Track the clips with one step left out at a time, and print only the effect of each step.
    #[arg(long, conflicts_with_all = ["candidates", "joins"])]
    pub layers: bool,
    /// Write all tracks into a CSV file: whether each is a vehicle, and the features of `exists_p`.
    #[arg(long, value_name = "FILE")]
    pub candidates: Option<PathBuf>,
    /// Write all joins over gaps into a CSV file: whether each is right, and the features of `same_vehicle_p`. Improbable
    /// joins are kept then.
    #[arg(long, value_name = "FILE")]
    pub joins: Option<PathBuf>,
    /// Standard deviation of keypoints and of boxes' edges, as a share of the box's longer side.
    #[arg(long, default_value_t = 0.02, value_name = "SHARE", value_parser = share)]
    pub noise: f64,
    /// Share of the vehicles that have no box in a frame.
    #[arg(long, default_value_t = 0.1, value_name = "SHARE", value_parser = share)]
    pub misses: f64,
    /// Number of boxes without a vehicle, as a share of the vehicles.
    #[arg(long, default_value_t = 0.05, value_name = "SHARE", value_parser = share)]
    pub false_boxes: f64,
    /// Share of the boxes that get a wrong class.
    #[arg(long, default_value_t = 0.05, value_name = "SHARE", value_parser = share)]
    pub flips: f64,
    /// Share of the boxes that get the keypoints of an overlapping vehicle.
    #[arg(long, default_value_t = 0.05, value_name = "SHARE", value_parser = share)]
    pub swaps: f64,
    /// Measure every n-th frame.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub stride: u32,
    /// Seed of the simulated errors.
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// Write the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// A number format in which the detector runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NumberFormat {
    /// 32-bit numbers.
    F32,
    /// 8-bit integers.
    Int8,
    /// 16-bit numbers, by OpenVINO.
    Bf16,
}

/// Arguments of `roadplane-lab eval detector`.
#[derive(Debug, Args)]
pub struct EvalDetectorArgs {
    /// JSON lists of pictures with true boxes, folders of data sets (dataset.json; only their stills), or folders of
    /// pictures without vehicles.
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Number formats to compare.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "f32,int8", value_name = "FORMAT")]
    pub format: Vec<NumberFormat>,
    /// Ignore vehicles with a narrower box, px; by default, the product's detect.min_width_px.
    #[arg(long, value_name = "PX", value_parser = width)]
    pub min_width_px: Option<f64>,
    /// Number of pictures to draw for each input, those with the most errors first; at most 100.
    #[arg(long, default_value_t = 8, value_name = "N", value_parser = clap::value_parser!(u32).range(..=100))]
    pub worst: u32,
    /// Write the tables as CSV and HTML, and the drawn pictures, into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Boxes in which the network estimates keypoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Boxes {
    /// The labelled boxes.
    True,
    /// The detector's boxes.
    Detected,
}

/// Arguments of `roadplane-lab eval keypoints`.
#[derive(Debug, Args)]
pub struct EvalKeypointsArgs {
    /// Label files (repeatable).
    #[arg(long, required = true, num_args = 1.., value_name = "FILE")]
    pub truth: Vec<PathBuf>,
    /// Folder of the images that the label files name.
    #[arg(long, value_name = "DIR")]
    pub images: PathBuf,
    /// Boxes in which the network estimates keypoints.
    #[arg(long, value_enum, default_value_t = Boxes::True)]
    pub boxes: Boxes,
    /// Number of cars to draw, the worst first.
    #[arg(long, default_value_t = 12, value_name = "N")]
    pub worst: usize,
    /// Write the tables as CSV and HTML, and worst.png, into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane-lab eval solver`.
#[derive(Debug, Args)]
pub struct EvalSolverArgs {
    /// Only measure how much each step of the solve improves the result, on synthetic scenes and on the pictures of
    /// --dataset and --cameras.
    #[arg(long)]
    pub layers: bool,
    /// Measure only the fusion of the frames of one camera: errors and normalised errors.
    #[arg(long, conflicts_with = "layers")]
    pub fused: bool,
    /// With --layers: folder of a data set (dataset.json), whose pictures are solved one by one.
    #[arg(long, value_name = "DIR", requires = "layers")]
    pub dataset: Option<PathBuf>,
    /// With --layers: real reference cameras (cameras.json).
    #[arg(long, value_name = "FILE", requires = "layers")]
    pub cameras: Option<PathBuf>,
    /// Scenes per row of the statistics; the noise-free table takes five times as many.
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub scenes: u32,
    /// Write the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane-lab eval cameras`.
#[derive(Debug, Args)]
pub struct EvalCamerasArgs {
    /// Folder with cameras.json and the pictures and clips that it names, or folder of a rendered data set.
    pub folder: PathBuf,
    /// Write the tables as CSV and HTML into this folder, and the runs into its subfolder runs; a later call reuses
    /// these runs.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Arguments of `roadplane-lab eval camera-database`.
#[derive(Debug, Args)]
pub struct EvalCameraDatabaseArgs {
    /// Number of cameras.
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub cameras: u32,
    /// Clips per camera.
    #[arg(long, default_value_t = 30, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=800))]
    pub clips: u32,
    /// Write the table as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
