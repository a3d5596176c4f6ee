//! KITTI tracking: one line per row of the run, and the camera in `calib/NAME.txt`.
//!
//! A line has the fields `frame id type truncated occluded alpha box(4) height width length x y z rotation_y score`.
//!
//! The position is the middle of the body's underside in the camera frame, m. KITTI has no tilt, so `rotation_y` is the
//! heading in the x–z plane of the camera. Each segment between camera moves is a separate sequence. A camera that turns
//! has its direction in each frame. A zoom cannot be described: the calibration file has one focal length.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Point3, UnitQuaternion, Vector3};
use roadplane_base::{VehicleClass, wrap_angle};
use roadplane_write::{FrameMotion, WriteError};

use super::files::{subfolder, write_text};
use crate::{Run, RunSegment};

/// Writes one label file and one calibration file per segment.
pub fn write(run: &Run, folder: &Path) -> Result<(), WriteError> {
    let (labels, calib) = (subfolder(folder, "label_02")?, subfolder(folder, "calib")?);
    for segment in &run.segments {
        let name = format!("{}.txt", segment.name);
        write_text(&labels.join(&name), &label_lines(run, segment))?;
        write_text(&calib.join(&name), &calib_lines(segment))?;
    }
    Ok(())
}

/// Returns KITTI's name of a vehicle class. KITTI has no class for buses, so the name is `Misc`. Motorcycles get
/// `Cyclist`, KITTI's class for riders.
fn kind(class: VehicleClass) -> &'static str {
    match class {
        VehicleClass::Car => "Car",
        VehicleClass::Truck => "Truck",
        VehicleClass::Bus => "Misc",
        VehicleClass::Motorcycle => "Cyclist",
    }
}

fn label_lines(run: &Run, segment: &RunSegment) -> String {
    let at_rest = segment.camera.plane().camera_from_world();
    let centre_px = segment.camera.principal_point_px.into();
    let mut text = String::new();
    for (track, row) in run.rows().into_iter().filter(|(_, row)| segment.contains(row)) {
        let view = run.motion.get(&row.frame).and_then(FrameMotion::homography);
        let turn = view.and_then(|view| view.turn(segment.camera.focal_px, &centre_px));
        let turn = turn.map_or(UnitQuaternion::identity(), |turn| turn.rotation.into());
        let camera_from_car = turn * at_rest * row.world_from_car();
        let at = camera_from_car * Point3::new(track.centre_m, 0.0, 0.0);
        let forward = camera_from_car.rotation * Vector3::x();
        let rotation_y = (-forward.z).atan2(forward.x);
        let alpha = wrap_angle(rotation_y - at.x.atan2(at.z));
        let [x0, y0, x1, y1] = row.bbox_px;
        let _infallible = writeln!(
            text,
            "{} {} {} -1 -1 {alpha:.5} {x0:.2} {y0:.2} {x1:.2} {y1:.2} {:.4} {:.4} {:.4} {:.4} {:.4} {:.4} {rotation_y:.5} {:.4}",
            row.frame,
            row.track,
            kind(track.class),
            row.height_m,
            row.width_m,
            row.length_m,
            at.x,
            at.y,
            at.z,
            row.score
        );
    }
    text
}

/// Returns the text of the calibration file.
///
/// KITTI's rig has four cameras, and the file contains the run's camera for each of them. The transformations for
/// rectification, laser scanner and inertial unit are identities.
fn calib_lines(segment: &RunSegment) -> String {
    let f = segment.camera.focal_px;
    let [cx, cy] = segment.camera.principal_point_px;
    let projection = format!("{f:.6} 0 {cx:.6} 0 0 {f:.6} {cy:.6} 0 0 0 1 0");
    let mut text: String = (0..4).fold(String::new(), |text, i| text + &format!("P{i}: {projection}\n"));
    text.push_str("R_rect 1 0 0 0 1 0 0 0 1\n");
    for name in ["Tr_velo_cam", "Tr_imu_velo"] {
        let _infallible = writeln!(text, "{name} 1 0 0 0 0 1 0 0 0 0 1 0");
    }
    text
}
