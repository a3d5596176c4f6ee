//! Arguments that place a camera on the map.

use std::path::PathBuf;

use clap::Args;

/// Position of a camera on the map.
#[derive(Debug, Args)]
pub struct SiteArgs {
    /// Put vehicles on the map by three or more surveyed points, one per line:
    /// x_px,y_px,latitude,longitude[,height_m][,frame]. If the camera moves, the pixels are those of the frame, or of
    /// the first picture.
    #[arg(long, value_name = "POINTS.csv", conflicts_with = "camera_at")]
    pub geo: Option<PathBuf>,
    /// Put vehicles on the map by the position and viewing direction of the camera, degrees. The bearing is clockwise
    /// from the grid north of the UTM zone, not from true north. All three numbers are taken as exact.
    #[arg(long, value_name = "LAT,LON,BEARING", value_delimiter = ',', allow_negative_numbers = true)]
    pub camera_at: Option<Vec<f64>>,
}
