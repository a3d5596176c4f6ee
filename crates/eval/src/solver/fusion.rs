//! What frames say of the camera, added up in information form.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, ShapeAtlas};
use roadplane_solve::{SceneOptions, solve_scene};
use roadplane_synth::{SynthOptions, scene};

use super::scenes::views;
use crate::parallel::in_parallel;
use crate::{Column, Table};

/// Cameras: focal length in image widths, height in m, tilt in rad.
const CAMERAS: [[f64; 3]; 5] =
    [[0.8, 6.0, 0.35], [1.3, 10.0, 0.45], [2.5, 20.0, 0.3], [1.0, 5.0, 0.25], [3.5, 25.0, 0.5]];
const CARS: usize = 10;

/// Error of the focal length that `frames` frames of ten different cars each give together, at 2 % noise.
#[must_use]
pub fn fusion_table(atlas: &ShapeAtlas, frames: usize) -> Table {
    let mut table = Table::new(
        format!("Fused over {frames} frames of {CARS} different cars, 2 % noise"),
        "One row a camera.",
        vec![
            Column::new("focal, image widths", 1),
            Column::new("focal error, %", 2),
            Column::new("reported sd, %", 2),
            Column::new("tilt error, °", 2),
            Column::new("height error, %", 2),
            Column::new("median error of one frame, %", 1),
        ],
    );
    for camera in CAMERAS {
        table.rows.push(row(atlas, camera, frames).map(Into::into).to_vec());
    }
    table
}

fn row(atlas: &ShapeAtlas, [ratio, height, tilt]: [f64; 3], frames: usize) -> [f64; 6] {
    let options = SceneOptions::default();
    let asked = SynthOptions {
        cars: CARS,
        noise: 0.02,
        focal_ratio: [ratio; 2],
        height_m: [height; 2],
        tilt: [tilt; 2],
        roll: [0.01; 2],
        box_px: [40.0, 700.0],
        ..SynthOptions::default()
    };
    let solved = in_parallel(frames, |frame| {
        let truth = scene(atlas, &asked, 5000 + frame as u64);
        let found = solve_scene(atlas, truth.size, &views(&truth), &options);
        (truth.params, found.information, found.information_vector, found.params.log_focal)
    });
    let prior = options.camera_prior.information();
    let mut information = Matrix4::from_diagonal(&prior);
    let mut vector: Vector4<f64> = options.camera_prior.mean(asked.size).to_vector().component_mul(&prior);
    let mut single = Vec::new();
    let mut truth = CameraParams::from_vector(&Vector4::zeros());
    for (params, frame_information, frame_vector, log_focal) in solved {
        information += frame_information;
        vector += frame_vector;
        single.push(100.0 * (log_focal - params.log_focal).exp_m1().abs());
        truth = params;
    }
    let covariance = information.cholesky().map_or(Matrix4::from_element(f64::NAN), |c| c.inverse());
    let off = covariance * vector - truth.to_vector();
    [
        ratio,
        100.0 * off[0].exp_m1(),
        100.0 * covariance[(0, 0)].sqrt(),
        off[1].to_degrees(),
        100.0 * off[3].exp_m1(),
        crate::median(&single),
    ]
}
