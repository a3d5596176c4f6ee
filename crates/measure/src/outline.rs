//! The projected outline of a body.

use nalgebra::{Point3, Vector3};
use roadplane_base::{GroundPose, VehicleClass};

use crate::FrameCamera;

/// Height of the bumpers' lower edge above the ground, m.
const CLEARANCE_M: f64 = 0.3;

/// Outline of a body: levels of half length and half width, at a height.
///
/// Half length is in lengths, half width in widths. The height is a share of the height above the bumpers' lower edge;
/// `None` is the ground, where only the wheels are.
type Outline = [(f64, f64, Option<f64>)];
/// Outline of trucks and buses: a box with wheels.
const BOX: &Outline = &[(0.5, 0.5, Some(1.0)), (0.5, 0.5, Some(0.0)), (0.3, 0.5, None)];
/// Outline of cars: roof, bonnet and boot, bumpers, wheels.
///
/// It is the atlas's mean car with equal front and rear, because a box does not distinguish them.
const SALOON: &Outline =
    &[(0.2, 0.35, Some(1.0)), (0.45, 0.45, Some(0.47)), (0.5, 0.4, Some(0.0)), (0.3, 0.5, None)];

/// Returns the box of a body on the ground in the picture, px.
///
/// `None` if a corner of its outline is not in front of the camera.
#[must_use]
pub fn body_box(
    view: &FrameCamera,
    pose: &GroundPose,
    class: VehicleClass,
    dims_m: &Vector3<f64>,
) -> Option<[f64; 4]> {
    let camera_from_car = view.camera_from_car(pose);
    let outline = if class == VehicleClass::Car { SALOON } else { BOX };
    let mut bbox = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for &(half_length, half_width, height) in outline {
        let z = height.map_or(0.0, |share| CLEARANCE_M + share * (dims_m.z - CLEARANCE_M));
        for (ahead, left) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let point = Point3::new(ahead * half_length * dims_m.x, left * half_width * dims_m.y, z);
            let pixel = view.camera.pixel_from_camera(&(camera_from_car * point).coords)?;
            bbox = [bbox[0].min(pixel.x), bbox[1].min(pixel.y), bbox[2].max(pixel.x), bbox[3].max(pixel.y)];
        }
    }
    Some(bbox)
}
