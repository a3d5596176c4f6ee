//! The site as the tracker needs it: sizes, boxes of bodies, positions of boxes.

use nalgebra::Vector3;
use roadplane_base::{FrameStamp, GroundPose, Shape, ShapeAtlas, VehicleClass};
use roadplane_measure::{Body, FrameCamera, Knowledge, body_box, body_of, car_body, ground_contact};
use roadplane_track::{BoxSighting, ExpectedVehicle, Placed, Scene, Size};

use crate::cameras::camera_track::CameraTrack;
use crate::tracks::views::Views;

/// Least sd of a heading that counts as unknown, rad.
const UNKNOWN_HEADING_SD_RAD: f64 = 1.5;

/// The site of a pass over the frames.
pub(super) struct SiteScene<'a> {
    /// Camera at every time.
    pub cameras: &'a CameraTrack,
    /// The shape atlas.
    pub atlas: &'a ShapeAtlas,
    /// Shape of the site's mean car.
    pub mean_car: &'a Shape,
    /// The part of the world picture that each frame shows.
    pub views: &'a Views,
}

impl Scene for SiteScene<'_> {
    fn size(&self, class: VehicleClass, shape: &Shape) -> Option<Size> {
        let body = match class {
            VehicleClass::Car => car_body(self.atlas, shape).at_best(),
            class => body_of(class),
        };
        Some(Size { dims_m: body.dims_m, covariance: body.covariance })
    }

    fn mean_car(&self) -> Option<Vector3<f64>> {
        Some(self.atlas.dims_m(self.mean_car))
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

    fn place(&self, stamp: &FrameStamp, seen: &BoxSighting, vehicle: &ExpectedVehicle) -> Option<Placed> {
        let Self { cameras, atlas, .. } = self;
        let estimate = cameras.at(stamp.time_s())?;
        let dims_m = vehicle.dims_m.unwrap_or_else(|| atlas.dims_m(&atlas.clamped(&vehicle.shape)));
        let knowledge = match vehicle.heading_sd_rad < UNKNOWN_HEADING_SD_RAD {
            true => Knowledge::Track {
                body: Body { dims_m, ..body_of(vehicle.class) },
                heading_rad: vehicle.heading_rad,
                heading_sd_rad: vehicle.heading_sd_rad,
            },
            false => Knowledge::Label(vehicle.class),
        };
        let picture_px = self.views.picture_px(stamp.index, estimate.image_size_px);
        let view = FrameCamera::from(estimate);
        let found = ground_contact(&seen.bbox_px, &picture_px, seen.hidden, &view, &knowledge)?;
        Some(Placed {
            pose: found.pose,
            covariance: found.covariance,
            dims_m: [found.dims_m, found.dims_sd_m],
        })
    }
}
