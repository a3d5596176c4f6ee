//! Formats of others: MOT Challenge (2D boxes) and KITTI tracking labels (3D boxes).

use std::path::Path;

use nalgebra::{Point3, Vector3};
use roadplane_base::{GroundPlane, GroundPose, TrackRow, VehicleClass, wrap_angle};

use crate::digits::not_finite;
use crate::{OutFile, WriteError};

fn checked(row: &TrackRow, file: &OutFile) -> Result<(), WriteError> {
    let path = || file.path().to_path_buf();
    not_finite(row).map_or(Ok(()), |what| Err(WriteError::NotFinite { what: what.to_owned(), path: path() }))
}

/// Writes MOT Challenge lines: `frame, id, left, top, width, height, confidence, -1, -1, -1`, frames from 1, boxes with
/// the top-left pixel's corner at (1, 1). Only observed rows.
#[derive(Debug)]
pub struct MotChallenge(OutFile);

impl MotChallenge {
    /// Starts a file.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn create(path: &Path) -> Result<Self, WriteError> {
        OutFile::create(path).map(Self)
    }

    /// Adds a row.
    ///
    /// # Errors
    /// [`WriteError::NotFinite`], [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn write(&mut self, row: &TrackRow) -> Result<(), WriteError> {
        checked(row, &self.0)?;
        if !row.observed {
            return Ok(());
        }
        let [x0, y0, x1, y1] = row.bbox_px;
        let line = format!(
            "{},{},{:.2},{:.2},{:.2},{:.2},{:.4},-1,-1,-1\n",
            row.frame + 1,
            row.track,
            x0 + 1.0,
            y0 + 1.0,
            x1 - x0,
            y1 - y0,
            row.score
        );
        self.0.write_bytes(line.as_bytes())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`]; then the file does not appear.
    pub fn finish(self) -> Result<(), WriteError> {
        self.0.finish()
    }
}

/// What KITTI calls a class; it has no name for buses.
fn kitti_type(class: VehicleClass) -> &'static str {
    match class {
        VehicleClass::Car => "Car",
        VehicleClass::Truck => "Truck",
        VehicleClass::Bus => "Misc",
    }
}

/// Writes KITTI tracking lines: `frame id type truncated occluded alpha box(4) height width length x y z rotation_y score`,
/// the position in the camera frame. KITTI knows no tilt: `rotation_y` is the heading seen in the camera's x–z plane.
/// The car's origin between the axles stands for the centre of the bottom of its box.
#[derive(Debug)]
pub struct KittiTracking {
    file: OutFile,
    camera_from_world: nalgebra::Isometry3<f64>,
}

impl KittiTracking {
    /// Starts a file of a camera above this ground.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn create(path: &Path, plane: &GroundPlane) -> Result<Self, WriteError> {
        Ok(Self { file: OutFile::create(path)?, camera_from_world: plane.camera_from_world() })
    }

    /// Adds a row.
    ///
    /// # Errors
    /// [`WriteError::NotFinite`], [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn write(&mut self, row: &TrackRow) -> Result<(), WriteError> {
        checked(row, &self.file)?;
        let pose = GroundPose { x_m: row.x_m, y_m: row.y_m, heading_rad: row.heading_rad };
        let camera_from_car = self.camera_from_world * pose.world_from_car();
        let at = camera_from_car * Point3::origin();
        let forward = camera_from_car.rotation * Vector3::x();
        let rotation_y = (-forward.z).atan2(forward.x);
        let alpha = wrap_angle(rotation_y - at.x.atan2(at.z));
        let [x0, y0, x1, y1] = row.bbox_px;
        let line = format!(
            "{} {} {} -1 -1 {:.5} {:.2} {:.2} {:.2} {:.2} {:.4} {:.4} {:.4} {:.4} {:.4} {:.4} {:.5} {:.4}\n",
            row.frame,
            row.track,
            kitti_type(row.class),
            alpha,
            x0,
            y0,
            x1,
            y1,
            row.height_m,
            row.width_m,
            row.length_m,
            at.x,
            at.y,
            at.z,
            rotation_y,
            row.score
        );
        self.file.write_bytes(line.as_bytes())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`]; then the file does not appear.
    pub fn finish(self) -> Result<(), WriteError> {
        self.file.finish()
    }
}
