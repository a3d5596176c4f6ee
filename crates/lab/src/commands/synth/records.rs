//! Converts synthetic items to the records of files. Poses are rounded to 1e-6 (m for positions), pixels to 0.01 px.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{CarRecord, FrameRecord, Keypoint, VehicleClass, rows_from_isometry};
use roadplane_metrics::truth::{
    Kind, Model, Rows, TRUTH_SCHEMA, TrueCamera, TrueCar, TrueFrame, TruePlane, Truth,
};
use roadplane_synth::{CarInFrame, Item};

fn rounded(value: f64, digits: i32) -> f64 {
    let scale = 10_f64.powi(digits);
    (value * scale).round() / scale + 0.0 // + 0.0: no negative zeros
}

fn rounded_rows(rows: Rows) -> Rows {
    rows.map(|row| row.map(|v| rounded(v, 6)))
}

fn time_s(item: &Item, frame: usize) -> f64 {
    item.fps.map_or(0.0, |fps| rounded(frame as f64 / fps, 6))
}

/// Returns the measured boxes and keypoints, one record per frame.
pub fn frames(item: &Item) -> impl Iterator<Item = FrameRecord> {
    item.frames.iter().enumerate().map(|(number, cars)| FrameRecord {
        cars: cars.iter().map(|car| car_record(item, car)).collect(),
        ..FrameRecord::empty(number as u64, time_s(item, number), item.size)
    })
}

fn car_record(item: &Item, car: &CarInFrame) -> CarRecord {
    let keypoints = car.keypoints.map(|found| {
        found.map(|point| {
            let pixel = point.pixel.map(|v| rounded(v, 2));
            Keypoint::isotropic(pixel, point.score, rounded(point.sd_px(), 3).max(0.001))
        })
    });
    CarRecord {
        keypoints: Some(Box::new(keypoints)),
        ..CarRecord::boxed(car.visible_box(item.size).0.map(|v| rounded(v, 2)))
    }
}

/// Returns the truth of an item. `conditions` are the options by which the item was made.
pub fn truth(item: &Item, conditions: BTreeMap<String, String>) -> Truth {
    let (plane, principal) = (item.params.plane(), item.size.centre_px());
    let seen: BTreeSet<usize> = item.frames.iter().flatten().map(|s| s.id).collect();
    let models = item.cars.iter().enumerate().filter(|(id, _)| seen.contains(id));
    Truth {
        schema: TRUTH_SCHEMA.to_owned(),
        media: None,
        kind: if item.fps.is_some() { Kind::Clip } else { Kind::Still },
        fps: item.fps,
        real: false,
        conditions,
        camera: TrueCamera {
            image_size_px: item.size,
            focal_px: item.params.focal_px(),
            principal_point_px: [principal.x, principal.y],
            height_m: plane.height_m,
            tilt_rad: plane.tilt(),
            roll_rad: plane.roll(),
            plane_in_camera: TruePlane { normal: plane.normal_in_camera.into(), offset_m: plane.height_m },
            camera_from_world: rows_from_isometry(&plane.camera_from_world()),
        },
        models: models
            .map(|(id, car)| Model {
                id: id as u64,
                class: VehicleClass::Car,
                body: "atlas".to_owned(),
                model: format!("atlas-{id}"),
                dims_m: car.dims_m.map(|v| rounded(v, 4)).into(),
                keypoints_in_car: car
                    .keypoints_in_car
                    .iter()
                    .map(|p| Some(p.map(|v| rounded(v, 6)).into()))
                    .collect(),
            })
            .collect(),
        frames: item
            .frames
            .iter()
            .enumerate()
            .map(|(number, cars)| TrueFrame {
                frame: number as u64,
                time_s: time_s(item, number),
                cars: cars.iter().map(|car| true_car(item, car)).collect(),
                picture_from_world: None,
            })
            .collect(),
    }
}

fn true_car(item: &Item, car: &CarInFrame) -> TrueCar {
    let (inside, share) = car.visible_box(item.size);
    let keypoint = |(pixel, found): (&nalgebra::Vector2<f64>, &Option<Keypoint>)| {
        Some([rounded(pixel.x, 2), rounded(pixel.y, 2), f64::from(u8::from(found.is_some()))])
    };
    TrueCar {
        id: car.id as u64,
        world_from_car: rounded_rows(rows_from_isometry(&car.state.pose.world_from_car())),
        speed_mps: rounded(car.state.speed_mps, 4),
        activity: car.state.activity,
        bbox_px: inside.map(|v| rounded(v, 2)),
        whole_bbox_px: car.whole_box.map(|v| rounded(v, 2)),
        visible_share: rounded(share, 3),
        keypoints_px: car.pixels.iter().zip(&car.keypoints).map(keypoint).collect(),
    }
}
