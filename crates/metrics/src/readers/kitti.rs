//! Reads the labels of the KITTI object and tracking benchmarks (Geiger et al. 2012). The file readme.txt of the
//! benchmarks describes the format.
//!
//! A label describes an object in the rectified frame of camera 0 (x right, y down, z forward). The object's origin is
//! the bottom centre of its 3D box. The angle `rotation_y` about the y axis is 0 if the object's length is along x.
//!
//! The images come from camera 2. Its projection `P2 = K [I | t]` contains the shift t between the two cameras. This
//! module returns poses in camera 2's frame.

mod calib;
mod folder;

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{field, lines, number};
use crate::MetricsError;

pub use calib::{KittiCamera, read_calib};
pub use folder::{KittiItem, object_items};

/// One labelled object.
#[derive(Clone, Debug, PartialEq)]
pub struct KittiObject {
    /// Type of the object: `Car`, `Van`, `Truck`, `Pedestrian`, … `DontCare`.
    pub kind: String,
    /// Share of the object outside the picture, 0–1; −1 if unknown.
    pub truncated: f64,
    /// Occlusion of the object: 0 fully visible, 1 partly hidden, 2 largely hidden, 3 unknown; −1 for `DontCare`.
    pub occluded: i32,
    /// Box in the picture: left, top, right, bottom, px. The centre of the first pixel is (0, 0), as everywhere in this
    /// project.
    pub bbox_px: [f64; 4],
    /// Length, width, height, m (the file's order is height, width, length).
    pub dims_m: [f64; 3],
    /// Bottom centre of the box in camera 0's frame, m.
    pub location_m: [f64; 3],
    /// Rotation of the object about the camera's y axis, rad.
    pub rotation_y: f64,
}

/// One labelled object in one frame of the tracking benchmark.
#[derive(Clone, Debug, PartialEq)]
pub struct KittiTracked {
    /// Index of the frame.
    pub frame: u64,
    /// Id of the track; −1 for `DontCare`.
    pub track: i64,
    /// The labelled object.
    pub object: KittiObject,
}

impl KittiObject {
    /// Returns whether the object is a `Car` or a `Van`. The shape atlas covers these two types.
    #[must_use]
    pub fn is_car(&self) -> bool {
        self.kind == "Car" || self.kind == "Van"
    }

    /// Returns whether the object is a `Car`, a `Van` or a `Truck`.
    #[must_use]
    pub fn is_vehicle(&self) -> bool {
        self.is_car() || self.kind == "Truck"
    }

    /// Returns the rigid motion from the box's frame to camera 2's frame.
    ///
    /// The box's frame has x forward, y left and z up. Its origin is the bottom centre of the box. The car frame of
    /// this project has another origin: the point midway between the axles.
    #[must_use]
    pub fn camera_from_box(&self, camera: &KittiCamera) -> Isometry3<f64> {
        let (sin, cos) = self.rotation_y.sin_cos();
        // The columns are the directions of the box's forward, left and up axes.
        let axes = Matrix3::from_columns(&[
            Vector3::new(cos, 0.0, -sin),
            Vector3::new(sin, 0.0, cos),
            Vector3::new(0.0, -1.0, 0.0),
        ]);
        Isometry3::from_parts(
            Translation3::from(Vector3::from(self.location_m) + camera.shift_m),
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)),
        )
    }
}

/// Reads the labels of one image of the object benchmark, `label_2/NNNNNN.txt`.
///
/// # Errors
/// [`MetricsError::Unreadable`], or [`MetricsError::Malformed`], which names the line and the field.
pub fn read_objects(path: &Path) -> Result<Vec<KittiObject>, MetricsError> {
    lines(path, words, object)
}

/// Reads the labels of one sequence of the tracking benchmark, `label_02/NNNN.txt`.
///
/// # Errors
/// [`MetricsError::Unreadable`], or [`MetricsError::Malformed`], which names the line and the field.
pub fn read_tracked(path: &Path) -> Result<Vec<KittiTracked>, MetricsError> {
    lines(path, words, |fields| {
        Ok(KittiTracked {
            frame: field(fields, 0, "frame")?,
            track: field(fields, 1, "track")?,
            object: object(fields.get(2..).unwrap_or_default())?,
        })
    })
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

fn object(fields: &[&str]) -> Result<KittiObject, String> {
    let kind = (*fields.first().ok_or("type is missing")?).to_owned();
    let at = |index: usize, name: &str| number(fields, index, name);
    let object = KittiObject {
        truncated: at(1, "truncated")?,
        occluded: field(fields, 2, "occluded")?,
        bbox_px: [at(4, "left")?, at(5, "top")?, at(6, "right")?, at(7, "bottom")?],
        dims_m: [at(10, "length")?, at(9, "width")?, at(8, "height")?],
        location_m: [at(11, "location x")?, at(12, "location y")?, at(13, "location z")?],
        rotation_y: at(14, "rotation_y")?,
        kind,
    };
    // In `DontCare` regions, fields without a label contain −1 or −1000.
    if object.kind != "DontCare" && !object.dims_m.iter().all(|d| *d > 0.0) {
        return Err("dimensions must be positive".to_owned());
    }
    let [x0, y0, x1, y1] = object.bbox_px;
    if x1 > x0 && y1 > y0 { Ok(object) } else { Err("the box has no area".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// A line in the benchmark's format, with invented numbers.
    const CAR: &str = "Car 0.80 3 -0.55 0.00 190.25 400.50 373.75 1.60 1.57 3.23 -2.70 1.74 3.68 -1.29";

    fn of(text: &str) -> Result<Vec<KittiObject>, MetricsError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000008.txt");
        std::fs::write(&path, text).unwrap();
        read_objects(&path)
    }

    #[test]
    fn a_label_is_read_in_our_order() {
        let text = format!("{CAR}\n\nDontCare -1 -1 -10 800 160 825 185 -1 -1 -1 -1000 -1000 -1000 -10\n");
        let objects = of(&text).unwrap();
        assert_eq!((objects.len(), objects[0].occluded), (2, 3));
        assert_eq!(objects[0].dims_m, [3.23, 1.57, 1.60]);
        assert!(objects[0].is_car() && !objects[1].is_vehicle());
    }

    #[test]
    fn the_axes_are_those_of_the_development_kit() {
        // In computeBox3D.m, the corners are x ±l/2, y 0 … −h, z ±w/2. They are turned by [c 0 s; 0 1 0; −s 0 c], and
        // then shifted to the location.
        let object = &of(CAR).unwrap()[0];
        let camera = KittiCamera::new(721.5, [609.6, 172.9], Vector3::zeros());
        let pose = object.camera_from_box(&camera);
        let (sin, cos) = object.rotation_y.sin_cos();
        let theirs = |x: f64, y: f64, z: f64| {
            Point3::new(cos * x + sin * z - 2.70, y + 1.74, -sin * x + cos * z + 3.68)
        };
        // In the box's frame of this project, x is their x, y is their z, and z is their −y.
        for (ours, theirs) in [
            (Point3::new(1.6, 0.0, 0.0), theirs(1.6, 0.0, 0.0)),
            (Point3::new(0.0, 0.8, 0.0), theirs(0.0, 0.0, 0.8)),
            (Point3::new(1.6, -0.8, 1.5), theirs(1.6, -1.5, -0.8)),
        ] {
            assert!((pose * ours - theirs).norm() < 1e-9);
        }
        assert!((pose.rotation.to_rotation_matrix().matrix().determinant() - 1.0).abs() < 1e-9);
        // The shift between the cameras moves the pose.
        let shifted = KittiCamera::new(721.5, [609.6, 172.9], Vector3::new(0.06, 0.0, 0.0));
        let by = object.camera_from_box(&shifted).translation.vector - pose.translation.vector;
        assert!((by - Vector3::new(0.06, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn errors_name_the_fault() {
        for (text, word) in [
            ("Car 0.88 3", "line 1: left is missing"),
            ("Car 0.88 x -0.69 0 192 402 374 1.6 1.5 3.2 -2.7 1.7 3.6 -1.2", "occluded \"x\""),
            ("Car 0.88 3 -0.69 402 192 0 374 1.6 1.5 3.2 -2.7 1.7 3.6 -1.2", "no area"),
            ("Car 0.88 3 -0.69 0 192 402 374 1.6 0 3.2 -2.7 1.7 3.6 -1.2", "dimensions"),
            ("Car 0.88 3 -0.69 0 192 402 374 1.6 1.5 3.2 nan 1.7 3.6 -1.2", "not finite"),
        ] {
            let error = of(text).unwrap_err().to_string();
            assert!(error.contains(word) && error.ends_with("000008.txt"), "{error}");
        }
    }

    #[test]
    fn labels_of_tracks_start_with_frame_and_track() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0000.txt");
        std::fs::write(&path, format!("3 7 {CAR}\n3 -1 {CAR}\n")).unwrap();
        let tracked = read_tracked(&path).unwrap();
        assert_eq!((tracked[0].frame, tracked[0].track, tracked[1].track), (3, 7, -1));
        assert_eq!(tracked[0].object, of(CAR).unwrap()[0]);
    }
}
