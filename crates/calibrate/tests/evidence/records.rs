//! Simulated frames with boxes and keypoints of cars that are stationary or move in the picture.

use nalgebra::Vector2;
use roadplane_base::{CarRecord, FrameRecord, ImageSize, KEYPOINTS, Keypoint};
use roadplane_synth::Rng;

/// A box that moves in the picture at a constant velocity.
#[derive(Clone, Copy)]
pub struct Moving {
    /// Box at time 0: left, top, right, bottom, px.
    pub bbox_px: [f64; 4],
    /// Velocity of the box, px/s.
    pub velocity_px_s: [f64; 2],
}

/// Returns a stationary box with the given left, top and width, px.
pub fn still(x: f64, y: f64, width: f64) -> Moving {
    Moving { bbox_px: [x, y, x + width, y + 0.6 * width], velocity_px_s: [0.0; 2] }
}

/// Returns two rows of `n` parked cars each.
pub fn rows(n: usize) -> Vec<Moving> {
    (0..2 * n)
        .map(|i| {
            let (row, column) = ((i / n) as f64, (i % n) as f64);
            still(120.0 + 260.0 * column + 40.0 * row, 300.0 + 250.0 * row, 150.0 + 50.0 * row)
        })
        .collect()
}

/// Size of the simulated pictures, px.
pub const SIZE: ImageSize = ImageSize { width: 1920, height: 1080 };

/// Returns a frame of these cars, with keypoints on a grid in each box.
///
/// The predicted sd of a keypoint is `sd_px`, px. Its actual noise has `white` times this sd.
pub fn frame(
    index: u64,
    time_s: f64,
    cars: &[Moving],
    sd_px: f64,
    white: f64,
    random: &mut Rng,
) -> FrameRecord {
    let cars = cars
        .iter()
        .map(|car| {
            let shift = Vector2::from(car.velocity_px_s) * time_s;
            let [x0, y0, x1, y1] = car.bbox_px;
            let mut jitter = || sd_px * white * random.normal();
            let keypoint = |i: usize, dx: f64, dy: f64| {
                let at = Vector2::new(
                    x0 + (x1 - x0) * (0.5 + (i % 6) as f64) / 6.0 + dx,
                    y0 + (y1 - y0) * (0.5 + (i / 6) as f64) / 6.0 + dy,
                );
                Keypoint::isotropic(at + shift, 0.9, sd_px)
            };
            let set = std::array::from_fn(|i| {
                let (dx, dy) = (jitter(), jitter());
                (i < KEYPOINTS / 2).then(|| keypoint(i, dx, dy))
            });
            let bbox_px = [x0 + shift.x, y0 + shift.y, x1 + shift.x, y1 + shift.y];
            CarRecord {
                bbox_px: bbox_px.map(|x| x + 0.5 * jitter().clamp(-3.0, 3.0)),
                score: 0.9,
                keypoints: Some(Box::new(set)),
                ..CarRecord::boxed(bbox_px)
            }
        })
        .collect();
    FrameRecord { cars, ..FrameRecord::empty(index, time_s, SIZE) }
}
