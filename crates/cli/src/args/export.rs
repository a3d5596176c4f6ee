//! Arguments of `roadplane export`.

use std::path::PathBuf;

use clap::Args;

/// `roadplane export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Folder of the finished run, DIR/<stem>.
    #[arg(value_name = "RUN")]
    pub run: Option<PathBuf>,
    /// Formats, separated by commas; `list` says what there is and what each holds.
    #[arg(long, value_name = "F", value_delimiter = ',', required = true)]
    pub format: Vec<String>,
    /// Each format gets a folder FOLDER/<format>/, complete or not there at all.
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Puts the run on the map by surveyed points, three or more: x_px,y_px,latitude,longitude[,height_m] a line.
    #[arg(long, value_name = "POINTS.csv", conflicts_with = "camera_at")]
    pub geo: Option<PathBuf>,
    /// Puts the run on the map by where the camera stands and looks: degrees, bearing clockwise from north.
    #[arg(long, value_name = "LAT,LON,BEARING", value_delimiter = ',', allow_negative_numbers = true)]
    pub camera_at: Option<Vec<f64>>,
    /// Replaces finished folders (once the new one is complete).
    #[arg(long)]
    pub overwrite: bool,
}
