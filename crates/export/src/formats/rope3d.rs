//! Rope3D and DAIR-V2X: the camera of detectors for roadside cameras.
//!
//! `calib/NAME.txt` has the projection matrix `P2`, as in KITTI. `denorm/NAME.txt` has the ground plane in the camera
//! frame: `a b c d` with a·x + b·y + c·z + d = 0, in metres. The normal (a, b, c) is a unit vector that points up, so `d`
//! is the height of the camera. These data sets have files for each picture, but the camera of a segment does not
//! change. So each segment has one file. If the camera sways, pans or zooms, the files have the camera of the segment's
//! first picture.

use std::path::Path;

use roadplane_write::WriteError;

use super::files::{subfolder, write_text};
use crate::{Run, fixed};

/// Writes the projection and the ground plane of each segment.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let (calib, denorm) = (subfolder(folder, "calib")?, subfolder(folder, "denorm")?);
    for segment in &run.segments {
        let name = format!("{}.txt", segment.name);
        let f = segment.camera.focal_px;
        let [cx, cy] = segment.camera.principal_point_px;
        let projection = [f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0].map(|v| fixed(v, 6));
        write_text(&calib.join(&name), &format!("P2: {}\n", projection.join(" ")))?;
        let plane = segment.camera.plane();
        let n = plane.normal_in_camera;
        let plane = [n.x, n.y, n.z, plane.height_m].map(|v| fixed(v, 9));
        write_text(&denorm.join(&name), &format!("{}\n", plane.join(" ")))?;
    }
    Ok(())
}
