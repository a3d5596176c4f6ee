//! Tests of symmetries: enlarged pictures, mirrored pictures and other units of length change a solution predictably.
//!
//! Small differences, far below the sd, remain. They come from the stopping rules and from the poses at which the
//! whitening is computed.

use nalgebra::{Matrix2, Vector2, Vector4};
use roadplane_base::{ImageSize, Keypoint, KeypointSet, ShapeAtlas, angle_difference, mirror_index};
use roadplane_solve::{CameraPrior, CarView, SceneOptions, SceneSolution, solve_scene};
use roadplane_synth::{SceneTruth, SynthOptions, scene};

const SCENES: u64 = 12;
/// Largest allowed difference between two solutions, in standard deviations.
const SAME: f64 = 2e-3;

fn options() -> SceneOptions {
    let mut options = SceneOptions { camera_prior: CameraPrior::none(), ..SceneOptions::default() };
    options.lm.cost_tolerance = 1e-14;
    options
}

fn solved(atlas: &ShapeAtlas, size: ImageSize, sets: &[KeypointSet]) -> SceneSolution {
    solve_scene(atlas, size, &CarView::each(sets), &options())
}

fn sets(truth: &SceneTruth) -> Vec<KeypointSet> {
    truth.cars.iter().map(|car| car.keypoints).collect()
}

fn scenes(atlas: &ShapeAtlas) -> impl Iterator<Item = SceneTruth> {
    let asked = SynthOptions { cars: 6, noise: 0.01, outliers: 0.05, ..SynthOptions::default() };
    (0..SCENES).map(move |seed| scene(atlas, &asked, 300 + seed))
}

/// Returns how far the difference `b` − `a` of two cameras is from the `expected` difference, in sds.
fn off_in_sd(a: &SceneSolution, b: &SceneSolution, expected: Vector4<f64>) -> f64 {
    let sd = a.covariance.diagonal().map(f64::sqrt);
    (b.params.to_vector() - a.params.to_vector() - expected).component_div(&sd).amax()
}

/// Maps all keypoints by an affine map of the image; `linear` is the diagonal linear part of the map.
fn mapped(
    set: &KeypointSet,
    pixel: impl Fn(Vector2<f64>) -> Vector2<f64>,
    linear: Matrix2<f64>,
) -> KeypointSet {
    let point = |k: &Keypoint| Keypoint {
        pixel: pixel(k.pixel),
        covariance_px2: linear * k.covariance_px2 * linear,
        ..*k
    };
    set.each_ref().map(|k| k.as_ref().map(point))
}

#[test]
fn an_enlarged_picture_gives_a_longer_focal_length_and_the_same_world() {
    let atlas = ShapeAtlas::shipped().unwrap();
    for truth in scenes(&atlas) {
        let size = truth.size;
        let larger = ImageSize { width: 2 * size.width, height: 2 * size.height };
        let (centre, new_centre) = (size.centre_px(), larger.centre_px());
        let enlarge = |p: Vector2<f64>| (p - centre) * 2.0 + new_centre;
        let enlarged: Vec<KeypointSet> =
            sets(&truth).iter().map(|set| mapped(set, enlarge, Matrix2::identity() * 2.0)).collect();
        let (a, b) = (solved(&atlas, size, &sets(&truth)), solved(&atlas, larger, &enlarged));
        assert!(off_in_sd(&a, &b, Vector4::new(2f64.ln(), 0.0, 0.0, 0.0)) < SAME);
        assert!((a.cost - b.cost).abs() < 1e-6 * a.cost);
        for (a, b) in a.cars.iter().flatten().zip(b.cars.iter().flatten()) {
            assert!((a.ground.x_m - b.ground.x_m).abs() < 2e-3 && (a.ground.y_m - b.ground.y_m).abs() < 2e-3);
        }
    }
}

#[test]
fn a_mirrored_picture_gives_the_mirrored_world() {
    let atlas = ShapeAtlas::shipped().unwrap();
    for truth in scenes(&atlas) {
        let width = f64::from(truth.size.width);
        let flip = Matrix2::new(-1.0, 0.0, 0.0, 1.0);
        let mirrored: Vec<KeypointSet> = sets(&truth)
            .iter()
            .map(|set| mapped(set, |p| Vector2::new(width - 1.0 - p.x, p.y), flip))
            .map(|set| std::array::from_fn(|i| set[mirror_index(i)]))
            .collect();
        let (a, b) = (solved(&atlas, truth.size, &sets(&truth)), solved(&atlas, truth.size, &mirrored));
        assert!(off_in_sd(&a, &b, Vector4::new(0.0, 0.0, -2.0 * a.params.roll, 0.0)) < SAME);
        for (a, b) in a.cars.iter().flatten().zip(b.cars.iter().flatten()) {
            let turned = angle_difference(b.ground.heading_rad, std::f64::consts::PI - a.ground.heading_rad);
            assert!((a.ground.x_m + b.ground.x_m).abs() < 2e-3 && turned.abs() < 1e-4);
        }
    }
}

#[test]
fn cars_of_half_size_give_a_world_of_half_size() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let mut small = atlas.clone();
    let shapes = small.modes.iter_mut().chain(&mut small.fine_modes).flatten().chain(&mut small.mean);
    for point in shapes.chain(&mut small.residual_sd_m).chain(&mut small.fine_residual_sd_m) {
        *point *= 0.5;
    }
    for truth in scenes(&atlas) {
        let (a, b) = (solved(&atlas, truth.size, &sets(&truth)), solved(&small, truth.size, &sets(&truth)));
        assert!(off_in_sd(&a, &b, Vector4::new(0.0, 0.0, 0.0, 0.5f64.ln())) < SAME);
        for (a, b) in a.cars.iter().flatten().zip(b.cars.iter().flatten()) {
            assert!((a.ground.y_m - 2.0 * b.ground.y_m).abs() < 1e-2);
        }
    }
}
