//! The facts of the scene that the tracker needs.

use nalgebra::Vector3;
use roadplane_base::{FrameStamp, GroundPose, Shape, VehicleClass};
use roadplane_measure::{Body, GroundContact, Knowledge, body_of};

use crate::Detection;

/// Knowledge of the scene, beyond the detections. It converts between boxes and poses.
pub trait Scene {
    /// Returns the body of vehicles of a class, for cars with this shape. By default, it is the mean body of the class.
    fn body(&self, class: VehicleClass, _shape: &Shape) -> Body {
        body_of(class)
    }

    /// Returns length, width and height of the site's mean car, m.
    fn mean_car(&self) -> Vector3<f64> {
        body_of(VehicleClass::Car).dims_m
    }

    /// Returns the box in which such a vehicle would be visible, px; `None` where it is not in front of the camera.
    fn body_px(
        &self,
        _stamp: &FrameStamp,
        _pose: &GroundPose,
        _class: VehicleClass,
        _dims_m: &Vector3<f64>,
    ) -> Option<[f64; 4]> {
        None
    }

    /// Returns pose and size of the vehicle in a box of this frame; `None` where the box does not place it.
    fn place(&self, stamp: &FrameStamp, seen: &Detection, known: &Knowledge) -> Option<GroundContact>;
}

/// A scene without a camera: boxes give no poses.
impl Scene for () {
    fn place(&self, _: &FrameStamp, _: &Detection, _: &Knowledge) -> Option<GroundContact> {
        None
    }
}
