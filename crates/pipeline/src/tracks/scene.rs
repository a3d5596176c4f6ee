//! The site as the tracker needs it: sizes, boxes of bodies, positions of boxes.

use nalgebra::Vector3;
use roadplane_base::{FrameStamp, GroundPose, Shape, ShapeAtlas, VehicleClass};
use roadplane_measure::{
    Body, FrameCamera, GroundContact, Knowledge, body_box, body_of, car_body, ground_contact,
};
use roadplane_track::{Detection, Scene};

use crate::cameras::camera_track::CameraTrack;

/// The site of a pass over the frames.
pub(super) struct SiteScene<'a> {
    pub cameras: &'a CameraTrack,
    pub atlas: &'a ShapeAtlas,
    /// Shape of the site's mean car.
    pub mean_car: &'a Shape,
}

impl Scene for SiteScene<'_> {
    fn body(&self, class: VehicleClass, shape: &Shape) -> Body {
        match class {
            VehicleClass::Car => car_body(self.atlas, shape).at_best(),
            class => body_of(class),
        }
    }

    fn mean_car(&self) -> Vector3<f64> {
        self.atlas.dims_m(self.mean_car)
    }

    fn body_px(
        &self,
        stamp: &FrameStamp,
        pose: &GroundPose,
        class: VehicleClass,
        dims_m: &Vector3<f64>,
    ) -> Option<[f64; 4]> {
        body_box(&FrameCamera::from(self.cameras.at(stamp.time_s())?), pose, class, dims_m)
    }

    fn place(&self, stamp: &FrameStamp, seen: &Detection, known: &Knowledge) -> Option<GroundContact> {
        let estimate = self.cameras.at(stamp.time_s())?;
        ground_contact(&seen.bbox_px, seen.cut, seen.hidden, &FrameCamera::from(estimate), known)
    }
}
