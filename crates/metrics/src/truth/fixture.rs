//! A small scene with truth for tests.

#![allow(clippy::unwrap_used, reason = "only tests use it, and a test that cannot go on has failed")]

use nalgebra::Point3;
use roadplane_base::{
    Activity, GroundPlane, GroundPose, ImageSize, ShapeAtlas, VehicleClass, rows_from_isometry,
};

use super::{Kind, Model, TRUTH_SCHEMA, TrueCamera, TrueCar, TrueFrame, TruePlane, Truth};

/// Returns the truth of a clip with three cars of the mean shape and a camera 6 m above the ground. Cars 0 and 1 are
/// parked 15 and 30 m ahead. Car 2 passes 22 m ahead at 5 m/s.
pub fn lot(frames: u64) -> Truth {
    let atlas = ShapeAtlas::shipped().unwrap();
    let plane = GroundPlane::from_tilt_roll_height(0.3, 0.0, 6.0);
    let size = ImageSize { width: 1280, height: 720 };
    let centre = size.centre_px();
    let normal = plane.normal_in_camera;
    let camera = TrueCamera {
        image_size_px: size,
        focal_px: 1000.0,
        principal_point_px: [centre.x, centre.y],
        height_m: 6.0,
        tilt_rad: 0.3,
        roll_rad: 0.0,
        plane_in_camera: TruePlane { normal: normal.into(), offset_m: 6.0 },
        camera_from_world: rows_from_isometry(&plane.camera_from_world()),
    };
    let model = |id: u64| Model {
        id,
        class: VehicleClass::Car,
        body: "mean".to_owned(),
        model: "atlas".to_owned(),
        dims_m: atlas.dims_mean.into(),
        keypoints_in_car: atlas.mean.iter().map(|p| Some((*p).into())).collect(),
    };
    let car = |id: u64, pose: GroundPose, speed_mps: f64| {
        let world_from_car = pose.world_from_car();
        let camera_from_car = plane.camera_from_world() * world_from_car;
        let pixel = |p: &nalgebra::Vector3<f64>| {
            camera.camera().pixel_from_camera(&(camera_from_car * Point3::from(*p)).coords).unwrap()
        };
        let pixels: Vec<_> = atlas.mean.iter().map(pixel).collect();
        let low = |i: usize| pixels.iter().map(|p| p[i]).fold(f64::INFINITY, f64::min);
        let high = |i: usize| pixels.iter().map(|p| p[i]).fold(f64::NEG_INFINITY, f64::max);
        let bbox_px = [low(0), low(1), high(0), high(1)];
        TrueCar {
            id,
            world_from_car: rows_from_isometry(&world_from_car),
            speed_mps,
            activity: if speed_mps > 0.0 { Activity::Moving } else { Activity::Parked },
            bbox_px,
            whole_bbox_px: bbox_px,
            visible_share: 1.0,
            keypoints_px: pixels.iter().map(|p| Some([p.x, p.y, 1.0])).collect(),
        }
    };
    let at = |x_m: f64, y_m: f64, heading_rad: f64| GroundPose { x_m, y_m, heading_rad };
    let frame = |frame: u64| {
        let time_s = frame as f64 * 0.1;
        let passing = at(-5.0 + 5.0 * time_s, 22.0, 0.0);
        let cars =
            vec![car(0, at(3.0, 15.0, 1.5), 0.0), car(1, at(-4.0, 30.0, -2.0), 0.0), car(2, passing, 5.0)];
        TrueFrame { frame, time_s, cars, picture_from_world: None }
    };
    Truth {
        schema: TRUTH_SCHEMA.to_owned(),
        media: None,
        kind: Kind::Clip,
        fps: Some(10.0),
        real: false,
        conditions: [("layout".to_owned(), "lot".to_owned())].into(),
        models: (0..3).map(model).collect(),
        frames: (0..frames).map(frame).collect(),
        camera,
    }
}
