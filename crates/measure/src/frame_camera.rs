//! The camera of a frame and the ground below it.

use nalgebra::{Isometry3, Point2, Vector2};
use roadplane_base::{Camera, CameraEstimate, Ground, GroundPart, GroundPose, bbox_foot};

/// The camera of a frame and the ground below it. Poses are in coordinates on the surface of the ground.
#[derive(Clone, Copy, Debug)]
pub struct FrameCamera {
    /// Camera with its lens.
    pub camera: Camera,
    /// Ground, whose planes are in the camera frame.
    pub ground: Ground,
}

impl From<&CameraEstimate> for FrameCamera {
    fn from(estimate: &CameraEstimate) -> Self {
        Self { camera: estimate.camera(), ground: estimate.ground() }
    }
}

impl FrameCamera {
    /// Returns the plane of the ground below the vehicle in a box.
    #[must_use]
    pub fn part_of_box(&self, bbox_px: &[f64; 4]) -> GroundPart {
        self.ground.part_of_ray(&self.camera.ray_from_pixel(&bbox_foot(bbox_px)))
    }

    /// Returns the point at which the viewing ray of a pixel meets the ground, on the surface, m.
    ///
    /// Returns `None` if the pixel lies at or above the horizon.
    #[must_use]
    pub fn surface_from_pixel(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let part = self.ground.part_of_ray(&self.camera.ray_from_pixel(pixel));
        let on_plane = part.plane.world_from_pixel(&self.camera, pixel)?;
        Some((part.surface_from_plane * Point2::from(on_plane)).coords)
    }

    /// Returns the rigid motion from the frame of a car at a pose on the surface to the camera frame.
    #[must_use]
    pub fn camera_from_car(&self, pose: &GroundPose) -> Isometry3<f64> {
        let part = self.ground.part_at(pose.x_m, pose.y_m);
        part.plane.camera_from_world() * part.from_surface(pose).world_from_car()
    }
}
