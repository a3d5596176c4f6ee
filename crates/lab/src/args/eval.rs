//! Arguments of `roadplane eval`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use roadplane_terminal::ConfigArgs;

/// `roadplane eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// What is evaluated.
    #[command(subcommand)]
    pub command: EvalCommand,
}

/// What is evaluated.
#[derive(Debug, Subcommand)]
pub enum EvalCommand {
    /// A finished run against truth: camera, tracks, poses, boxes.
    Run(EvalRunArgs),
    /// The paper's tables on a data set with truth: six systems on the same keypoints.
    Dataset(EvalDatasetArgs),
    /// What looking only at what changes costs: clips run with attention and without, with truth where it lies beside them.
    Attention(EvalAttentionArgs),
    /// The paper's Table 4: what vehicles do, told from 2D and from 3D motion, against truth.
    Activity(EvalActivityArgs),
    /// The paper's Table 3 on your own copy of the KITTI object benchmark: all systems on images with more than three vehicles.
    Kitti(EvalKittiArgs),
    /// Tracks of boxes against true ones, MOT Challenge files or KITTI tracking labels: HOTA, MOTA, IDF1.
    Tracks(EvalFilesArgs),
    /// The tracker alone, on what detector and keypoint net might measure of clips with truth: misses, false boxes, wrong labels.
    Tracker(EvalTrackerArgs),
    /// Detections against true boxes, both as COCO files: average precision by size.
    Boxes(EvalFilesArgs),
    /// The keypoint net on labelled images: errors per keypoint, size and body type, and the worst cars drawn.
    Keypoints(EvalKeypointsArgs),
    /// The joint solver on synthetic scenes with exact truth: accuracy against the Cramér–Rao bound, honesty, speed.
    Solver(EvalSolverArgs),
    /// CameraConstraints real cameras (cameras.json): how far off the product's are, car by car and keypoint by keypoint where from.
    Cameras(EvalCamerasArgs),
    /// Remembered cameras on synthetic clips with exact truth: error, bound and sd after 1, 3, 10, 30 nights.
    Remembered(EvalRememberedArgs),
}

/// `roadplane eval run`.
#[derive(Debug, Args)]
pub struct EvalRunArgs {
    /// Folder of the finished run, DIR/<stem>.
    pub run: PathBuf,
    /// Truth file (roadplane.truth/1), a calibrated camera (.krtd), vehicles of other sensors
    /// (.vehicles.json), or boxes (KPF, geom.yml with types.yml beside it).
    #[arg(long, value_name = "FILE")]
    pub truth: PathBuf,
    /// Writes the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// `roadplane eval attention`.
#[derive(Debug, Args)]
pub struct EvalAttentionArgs {
    /// Videos; NAME.truth.json(.gz) beside one is its truth.
    #[arg(required = true, value_name = "CLIP")]
    pub clips: Vec<PathBuf>,
    /// Writes the table as CSV and HTML into this folder, and both results of every clip below it.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// Keypoints that the systems get.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Keypoints {
    /// Our net's, in the true boxes.
    Net,
    /// True ones with noise.
    Noise,
    /// Each in tables of their own.
    Both,
}

/// `roadplane eval dataset`.
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
    /// Share of the items; 0.1 takes every tenth.
    #[arg(long, default_value_t = 1.0, value_name = "SHARE", value_parser = share)]
    pub part: f64,
    /// Every n-th frame of a clip is looked at.
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub stride: u32,
    /// Folder of real stills with calibrated cameras of the same name (.krtd): a table of its own.
    #[arg(long, value_name = "DIR")]
    pub real: Option<PathBuf>,
    /// Writes the tables as CSV and HTML, and the runs of the clips, into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

fn share(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_not_a_number| "must be a number".to_owned())?;
    if (0.0..=1.0).contains(&share) { Ok(share) } else { Err("must lie between 0 and 1".to_owned()) }
}

/// `roadplane eval activity`.
#[derive(Debug, Args)]
pub struct EvalActivityArgs {
    /// Folder with dataset.json: its clips are run and told per frame; or a table of labelled instances (.parquet, .csv,
    /// .jsonl), as `python -m activity.meva` writes.
    pub data: PathBuf,
    /// Writes the tables as CSV and HTML into this folder, and the runs of the clips below it; finished ones are used again.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane eval kitti`.
#[derive(Debug, Args)]
pub struct EvalKittiArgs {
    /// Folder with image_2, label_2 and calib, or with these in training/.
    pub folder: PathBuf,
    /// Share of the images, e.g. 0.1 for every tenth.
    #[arg(long, default_value_t = 1.0, value_name = "P")]
    pub part: f64,
    /// Writes the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane eval tracks` and `roadplane eval boxes`.
#[derive(Debug, Args)]
pub struct EvalFilesArgs {
    /// What was found.
    pub found: PathBuf,
    /// Ground-truth file.
    #[arg(long, value_name = "FILE")]
    pub truth: PathBuf,
    /// Writes the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// `roadplane eval tracker`.
#[derive(Debug, Args)]
pub struct EvalTrackerArgs {
    /// Truth files of clips (NAME.truth.json, gzipped or not; no video is needed), or folders with dataset.json.
    #[arg(required = true, value_name = "CLIP")]
    pub clips: Vec<PathBuf>,
    /// Standard deviation of keypoints and of boxes' edges, as a share of the box's longer side.
    #[arg(long, default_value_t = 0.02, value_name = "SHARE", value_parser = share)]
    pub noise: f64,
    /// Share of the vehicles that have no box in a frame.
    #[arg(long, default_value_t = 0.1, value_name = "SHARE", value_parser = share)]
    pub misses: f64,
    /// Boxes of nothing, as a share of the vehicles.
    #[arg(long, default_value_t = 0.05, value_name = "SHARE", value_parser = share)]
    pub false_boxes: f64,
    /// Share of the boxes that are called another class.
    #[arg(long, default_value_t = 0.05, value_name = "SHARE", value_parser = share)]
    pub flips: f64,
    /// Share of the boxes that get keypoints of a vehicle that they overlap with.
    #[arg(long, default_value_t = 0.05, value_name = "SHARE", value_parser = share)]
    pub swaps: f64,
    /// Every n-th frame is measured.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub stride: u32,
    /// Another number, other errors.
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// Writes the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// In which boxes keypoints are looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Boxes {
    /// The labelled ones.
    True,
    /// The detector's.
    Detected,
}

/// `roadplane eval keypoints`.
#[derive(Debug, Args)]
pub struct EvalKeypointsArgs {
    /// Label files (repeatable).
    #[arg(long, required = true, num_args = 1.., value_name = "FILE")]
    pub truth: Vec<PathBuf>,
    /// Folder of the images that they name.
    #[arg(long, value_name = "DIR")]
    pub images: PathBuf,
    /// In which boxes keypoints are looked for.
    #[arg(long, value_enum, default_value_t = Boxes::True)]
    pub boxes: Boxes,
    /// How many of the worst cars are drawn.
    #[arg(long, default_value_t = 12, value_name = "N")]
    pub worst: usize,
    /// Writes the tables as CSV and HTML, and worst.png, into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane eval solver`.
#[derive(Debug, Args)]
pub struct EvalSolverArgs {
    /// Instead: what each step of the solve is worth, on synthetic scenes and, where given, on those below.
    #[arg(long)]
    pub layers: bool,
    /// Instead: only what frames of one camera add up to (fused error / sd).
    #[arg(long, conflicts_with = "layers")]
    pub fused: bool,
    /// With --layers: folder of a data set (dataset.json), whose pictures are solved one by one.
    #[arg(long, value_name = "DIR", requires = "layers")]
    pub dataset: Option<PathBuf>,
    /// With --layers: real cameras that are known (cameras.json).
    #[arg(long, value_name = "FILE", requires = "layers")]
    pub cameras: Option<PathBuf>,
    /// Scenes a row of the statistics; five times as many noise-free ones.
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub scenes: u32,
    /// Writes the tables as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane eval cameras`.
#[derive(Debug, Args)]
pub struct EvalCamerasArgs {
    /// Folder with cameras.json and the pictures and clips that it names.
    pub folder: PathBuf,
    /// Writes the tables as CSV and HTML into this folder, and what was found in the pictures below it, which is used again.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub config: ConfigArgs,
}

/// `roadplane eval remembered`.
#[derive(Debug, Args)]
pub struct EvalRememberedArgs {
    /// Cameras.
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub cameras: u32,
    /// Clips of each.
    #[arg(long, default_value_t = 30, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=800))]
    pub clips: u32,
    /// Writes the table as CSV and HTML into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
