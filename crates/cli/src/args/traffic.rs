//! Arguments of `roadplane traffic`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// Arguments of `roadplane traffic`.
#[derive(Debug, Args)]
pub struct TrafficArgs {
    /// Folders of finished runs, folders that contain them, or tables of tracks (.csv, .parquet, .jsonl) with the columns
    /// time_s, track, x_m and y_m.
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Gates (lines) and zones (areas): GeoJSON in pixels, metres or WGS 84, or an .otflow file of OTAnalytics.
    #[arg(long, value_name = "FILE")]
    pub gates: Option<PathBuf>,
    /// Output folder, with a table in CSV and Parquet for each kind of figure, and traffic.json.
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Length of the periods: a number with s, min or h that divides a day.
    #[arg(long, value_name = "TIME", default_value = "15min")]
    pub every: String,
    /// Time zone of the clips' dates, such as Europe/Berlin.
    #[arg(long, value_name = "ZONE", default_value = "UTC")]
    pub time_zone: String,
    /// Local date and time of the first frame, such as 2026-01-31T22:00; otherwise the date in the run's name counts.
    #[arg(long, value_name = "TIME")]
    pub start: Option<String>,
    /// Camera of each run: a name, or a pattern of run names in which {} is the name and * matches any text. Runs of one
    /// camera share their tables.
    #[arg(long, value_name = "ID")]
    pub camera_id: Option<String>,
    /// Units of speeds.
    #[arg(long, value_enum, default_value = "kmh")]
    pub units: SpeedUnits,
    /// Replace a finished folder once the new one is complete.
    #[arg(long)]
    pub overwrite: bool,
}

/// Units of speeds.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SpeedUnits {
    /// Kilometres per hour.
    Kmh,
    /// Miles per hour.
    Mph,
}
