//! Accuracy of a camera that is fused from many frames by adding their information matrices.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::ShapeAtlas;
use roadplane_solve::{CarView, SceneOptions, solve_scene};
use roadplane_synth::{Rng, SynthOptions, scene};
use roadplane_tables::{Cell, Column, Table, bootstrap, median};

use crate::parallel::in_parallel;

/// Seed of the first camera.
const SEED: u64 = 5_000_000;
/// Number of cars in each frame.
const CARS: usize = 10;

/// Returns the table of the errors of fused cameras. Each camera is fused from `frames` frames with ten different cars
/// each.
///
/// The table is over `cameras` cameras. Keypoints have noise of 2 % of the box's longer side. The settings are the
/// defaults of `roadplane run`. As in real traffic, the shapes of the cars differ from the shape atlas.
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

/// A fused camera: errors and sds of (log f, tilt, roll, log h), and the same errors of each single frame.
///
/// Here f is the focal length and h the camera's height; angles are in rad.
struct Fused {
    error: Vector4<f64>,
    sd: Vector4<f64>,
    singles: Vec<Vector4<f64>>,
}

/// Makes a random camera and fuses its frames. Returns `None` if no car of the default sizes is in the camera's view.
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
