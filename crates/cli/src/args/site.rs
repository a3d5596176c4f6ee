//! Arguments that tell a camera's place on the map.

use std::path::PathBuf;

use clap::Args;

/// Where a camera stands.
#[derive(Debug, Args)]
pub struct SiteArgs {
    /// Puts vehicles on the map by surveyed points, three or more: x_px,y_px,latitude,longitude[,height_m] a line.
    #[arg(long, value_name = "POINTS.csv", conflicts_with = "camera_at")]
    pub geo: Option<PathBuf>,
    /// Puts vehicles on the map by where the camera stands and looks: degrees, bearing clockwise from north.
    #[arg(long, value_name = "LAT,LON,BEARING", value_delimiter = ',', allow_negative_numbers = true)]
    pub camera_at: Option<Vec<f64>>,
}
