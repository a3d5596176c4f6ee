//! Reads the camera's position on the map from the arguments.

use roadplane_geo::{Site, read_points};
use roadplane_pipeline::PipelineError;

use crate::args::site::SiteArgs;

/// Returns the site, or `None` if the arguments give no position of the camera.
pub fn site(args: &SiteArgs) -> Result<Option<Site>, PipelineError> {
    let (site, option) = if let Some(file) = &args.geo {
        (Site::Points(read_points(file)?), "--geo")
    } else if let Some(numbers) = args.camera_at.as_deref() {
        let [latitude, longitude, bearing_deg] = *numbers else {
            return Err(PipelineError::usage("--camera-at needs three numbers: LAT,LON,BEARING"));
        };
        (Site::Camera { at: [latitude, longitude], bearing_deg }, "--camera-at")
    } else {
        return Ok(None);
    };
    site.check().map_err(|what| PipelineError::usage(&format!("{option}: {what}")))?;
    Ok(Some(site))
}
