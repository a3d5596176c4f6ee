//! Fusion of the frames of one camera in information form.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::ShapeAtlas;
use roadplane_solve::{CarView, SceneOptions, solve_scene};
use roadplane_synth::{Rng, SynthOptions, scene};
use roadplane_tables::{Cell, Column, Table, bootstrap, median};

use crate::parallel::in_parallel;

/// First seed of the cameras.
const SEED: u64 = 5_000_000;
/// Number of cars in each frame.
const CARS: usize = 10;

/// Returns the errors of cameras that are each fused over `frames` frames of ten different cars, at 2 % noise.
///
/// There are `cameras` cameras. The settings are the product's, and the cars are those of traffic, which no atlas
/// spans.
#[must_use]
pub fn fusion_table(atlas: &ShapeAtlas, cameras: usize, frames: usize) -> Table {
    let mut table = Table::new(
        format!("Fused over {frames} frames of {CARS} different cars, 2 % noise: {cameras} cameras"),
        "Normalised error: root mean square of errors in sds; 1 is calibrated. 95 % intervals by resampling cameras.",
        vec![
            Column::new("", 0),
            Column::new("median of one frame", 2),
            Column::new("fused, median", 2),
            Column::new("claimed sd, median", 2),
            Column::new("mean error", 2),
            Column::new("normalised error", 2),
        ],
    );
    let fused: Vec<Fused> = (SEED..).filter_map(|seed| fuse(atlas, seed, frames)).take(cameras).collect();
    for (name, number, unit) in
        [("focal, %", 0, 100.0), ("tilt, °", 1, 1f64.to_degrees()), ("height, %", 3, 100.0)]
    {
        let each = |value: &dyn Fn(&Fused) -> f64| -> Vec<Vec<f64>> {
            fused.iter().map(|camera| vec![value(camera)]).collect()
        };
        let singles: Vec<f64> = fused
            .iter()
            .flat_map(|camera| camera.singles.iter().map(move |single| unit * single[number].abs()))
            .collect();
        let rms =
            |values: &[f64]| roadplane_tables::mean(&values.iter().map(|v| v * v).collect::<Vec<_>>()).sqrt();
        table.rows.push(vec![
            name.into(),
            median(&singles).into(),
            Cell::from(bootstrap(&each(&|camera| unit * camera.error[number].abs()), median)),
            median(&fused.iter().map(|camera| unit * camera.sd[number]).collect::<Vec<_>>()).into(),
            Cell::from(bootstrap(&each(&|camera| unit * camera.error[number]), roadplane_tables::mean)),
            Cell::from(bootstrap(&each(&|camera| camera.error[number] / camera.sd[number]), rms)),
        ]);
    }
    table
}

/// A fused camera: errors and sds of (log f, tilt, roll, log h), and the errors of the single frames.
struct Fused {
    error: Vector4<f64>,
    sd: Vector4<f64>,
    singles: Vec<Vector4<f64>>,
}

/// Fuses the frames of one camera. Returns `None` if the camera can see no car of the given sizes.
fn fuse(atlas: &ShapeAtlas, seed: u64, frames: usize) -> Option<Fused> {
    let options = SceneOptions::default();
    let mut rng = Rng::new(seed);
    let any = SynthOptions::default();
    let mut drawn = |[low, high]: [f64; 2]| [rng.uniform(low, high); 2];
    let asked = SynthOptions {
        cars: CARS,
        noise: 0.02,
        off_atlas: 1.0,
        focal_ratio: drawn(any.focal_ratio.map(f64::ln)).map(f64::exp),
        height_m: drawn(any.height_m),
        tilt: drawn(any.tilt),
        roll: drawn(any.roll),
        ..any
    };
    if scene(atlas, &asked, seed * 1000).cars.is_empty() {
        return None;
    }
    let solved = in_parallel(frames, |frame| {
        let truth = scene(atlas, &asked, seed * 1000 + frame as u64);
        let found = solve_scene(atlas, truth.size, &CarView::each(truth.keypoints()), &options);
        (truth.params.to_vector(), found.information, found.params.to_vector())
    });
    let prior = options.camera_prior.information();
    let mut information = Matrix4::from_diagonal(&prior);
    let mut vector: Vector4<f64> = options.camera_prior.mean(asked.size).to_vector().component_mul(&prior);
    for (_, frame, _) in &solved {
        let (own, own_vector) = frame.marginal(options.shared_sd());
        information += own;
        vector += own_vector;
    }
    let truth = solved.first()?.0;
    let covariance = information.cholesky()?.inverse();
    Some(Fused {
        error: covariance * vector - truth,
        sd: covariance.diagonal().map(f64::sqrt),
        singles: solved.iter().map(|(_, _, found)| found - truth).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_frames_are_more_accurate_than_one() {
        let atlas = ShapeAtlas::shipped().unwrap();
        let fused = fuse(&atlas, 3, 12).unwrap();
        let singles: Vec<f64> = fused.singles.iter().map(|single| single[0].abs()).collect();
        assert!(fused.error[0].abs() < median(&singles) && fused.sd[0] < 0.05, "{}", fused.error);
    }
}
