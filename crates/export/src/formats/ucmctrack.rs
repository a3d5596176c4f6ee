//! UCMCTrack (Yi et al. 2024): the camera of the tracker, `cam_para/NAME.txt`.
//!
//! The file has the rotation from world to camera, the translation in millimetres, and the intrinsic matrix. The camera
//! has no distortion. The world frame is that of the run, with the ground at z = 0. Each segment between camera moves has
//! its own file. If the camera sways, pans or zooms, the file has the camera of the segment's first picture.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Matrix3;
use roadplane_write::WriteError;

use super::files::{subfolder, write_text};
use crate::{Run, RunSegment, fixed};

/// Writes one file per segment.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let folder = subfolder(folder, "cam_para")?;
    for segment in &run.segments {
        write_text(&folder.join(format!("{}.txt", segment.name)), &parameters(segment))?;
    }
    Ok(())
}

fn parameters(segment: &RunSegment) -> String {
    let camera_from_world = segment.camera.plane().camera_from_world();
    let f = segment.camera.focal_px;
    let [cx, cy] = segment.camera.principal_point_px;
    let rotation = camera_from_world.rotation.to_rotation_matrix();
    let translation_mm = camera_from_world.translation.vector * 1e3;
    let intrinsic = Matrix3::new(f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0);
    let mut text = String::from("RotationMatrices\n");
    text.push_str(&lines(rotation.matrix(), 9));
    let [x, y, z] = [translation_mm.x, translation_mm.y, translation_mm.z].map(|mm| fixed(mm, 3));
    let _infallible = writeln!(text, "\nTranslationVectors\n{x} {y} {z}\n\nIntrinsicMatrix");
    text.push_str(&lines(&intrinsic, 4));
    text
}

fn lines(matrix: &Matrix3<f64>, decimals: usize) -> String {
    let line = |row: usize| [0, 1, 2].map(|column| fixed(matrix[(row, column)], decimals)).join(" ") + "\n";
    [0, 1, 2].map(line).concat()
}
