//! Accuracy of the cars' poses with and without the common ground plane, and with the focal length given or unknown.

use nalgebra::{Isometry3, Point3};
use roadplane_base::ShapeAtlas;
use roadplane_pipeline::PLANE_TERMS;
use roadplane_solve::{CarView, SceneOptions, solve_free_scene, solve_scene};
use roadplane_synth::{SceneTruth, SynthOptions, scene};
use roadplane_tables::{Column, Table, bootstrap, median, quantile, share_within};

use crate::parallel::in_parallel;
use roadplane_metrics::{add, viewpoint};

/// Seed of the first scene; later scenes have the next seeds.
const SEED: u64 = 2_000_000;

/// The variants of the solver that are compared.
#[derive(Clone, Copy)]
enum Variant {
    /// Each car has a pose with six degrees of freedom.
    Free,
    /// As `Free`, with additional cost terms for each car's distance from a common plane (paper *Car Pose in Context*).
    PlaneTerms,
    /// The pose of every car is constrained to one plane.
    OnPlane,
}

/// The errors of the cars of one scene, and the relative error of the scene's focal length.
struct Errors {
    add_diameters: Vec<f64>,
    rotation_rad: Vec<f64>,
    focal: f64,
}

/// Returns two tables over `scenes` scenes: ADD (average distance of the points of the true shapes) and viewpoint
/// precision.
///
/// Each scene has 10 cars, whose shapes differ from the shape atlas. Of the keypoints 60 % are visible, with noise of 2
/// % of the box's longer side and 5 % outliers.
#[must_use]
pub fn ablation_tables(atlas: &ShapeAtlas, scenes: usize) -> Vec<Table> {
    let percent = |limits: &[f64], unit: &str| -> Vec<Column> {
        limits.iter().map(|limit| Column::new(format!("{limit} {unit}"), 1)).collect()
    };
    let mut adds = Table::new(
        "Ablation: ADD within the threshold, % of cars",
        "Thresholds in diameters of the car. 10 cars, 2 % noise, 5 % outliers, cars beside the atlas. Cars without an answer count as wrong.",
        [vec![Column::new("", 0)], percent(&add::THRESHOLDS, "d")].concat(),
    );
    let mut views = Table::new(
        "Ablation: viewpoint precision, % of cars",
        "",
        [
            vec![Column::new("", 0)],
            percent(&viewpoint::THRESHOLDS_RAD, "rad"),
            vec![
                Column::new("median, °", 2),
                Column::new("focal, median %", 1),
                Column::new("focal, 90 % within %", 1),
            ],
        ]
        .concat(),
    );
    for (name, variant, given_focal) in [
        ("free poses, focal known", Variant::Free, true),
        ("free poses, focal from the prior", Variant::Free, false),
        ("plane terms (paper), focal known", Variant::PlaneTerms, true),
        ("plane terms (paper), focal estimated", Variant::PlaneTerms, false),
        ("on the plane, focal known", Variant::OnPlane, true),
        ("on the plane, focal estimated", Variant::OnPlane, false),
    ] {
        let errors = in_parallel(scenes, |i| errors_of(atlas, variant, given_focal, SEED + i as u64));
        let all: Vec<Vec<f64>> = errors.iter().map(|e| e.add_diameters.clone()).collect();
        let within = |values: &[Vec<f64>], limit: f64| {
            roadplane_tables::Cell::from(bootstrap(values, |v| share_within(v, limit)).scaled(100.0))
        };
        let mut row = vec![name.into()];
        row.extend(add::THRESHOLDS.map(|limit| within(&all, limit)));
        adds.rows.push(row);
        let all: Vec<Vec<f64>> = errors.iter().map(|e| e.rotation_rad.clone()).collect();
        let mut row = vec![name.into()];
        row.extend(viewpoint::THRESHOLDS_RAD.map(|limit| within(&all, limit)));
        row.push(bootstrap(&all, median).scaled(1f64.to_degrees()).into());
        let focal: Vec<Vec<f64>> = errors.iter().map(|e| vec![100.0 * e.focal]).collect();
        row.push(bootstrap(&focal, median).into());
        row.push(bootstrap(&focal, |v| quantile(v, 0.9)).into());
        views.rows.push(row);
    }
    vec![adds, views]
}

fn errors_of(atlas: &ShapeAtlas, variant: Variant, given_focal: bool, seed: u64) -> Errors {
    let asked =
        SynthOptions { cars: 10, noise: 0.02, outliers: 0.05, off_atlas: 1.0, ..SynthOptions::default() };
    let truth = scene(atlas, &asked, seed);
    let options = SceneOptions {
        given_focal_px: given_focal.then(|| truth.params.focal_px()),
        ..SceneOptions::default()
    };
    let views = CarView::each(truth.keypoints());
    let free = |plane| {
        let found = solve_free_scene(atlas, truth.size, &views, plane, &options);
        let poses = found.cars.iter().map(|car| car.as_ref().map(|car| car.camera_from_car));
        (found.params, poses.collect())
    };
    let (params, poses): (_, Vec<Option<Isometry3<f64>>>) = match variant {
        Variant::Free => free(None),
        Variant::PlaneTerms => free(Some(PLANE_TERMS)),
        Variant::OnPlane => {
            let found = solve_scene(atlas, truth.size, &views, &options);
            let poses = found.cars.iter().map(|car| car.as_ref().map(|car| car.camera_from_car));
            (found.params, poses.collect())
        }
    };
    let focal = (params.log_focal - truth.params.log_focal).exp_m1().abs();
    let (add_diameters, rotation_rad) = car_errors(&truth, &poses);
    Errors { add_diameters, rotation_rad, focal }
}

/// Returns the ADD (in car diameters) and the rotation error (rad) of every car. Both are infinite for a car without a
/// pose.
fn car_errors(truth: &SceneTruth, poses: &[Option<Isometry3<f64>>]) -> (Vec<f64>, Vec<f64>) {
    let camera_from_world = truth.params.plane().camera_from_world();
    let errors = |(car, pose): (&roadplane_synth::CarTruth, &Option<Isometry3<f64>>)| {
        let Some(pose) = pose else { return (f64::INFINITY, f64::INFINITY) };
        let true_pose = camera_from_world * car.pose.world_from_car();
        let points = car.keypoints_in_car.map(|p| Some(Point3::from(p)));
        let add_m = add::add_m(&points, &true_pose, &points, pose).unwrap_or(f64::INFINITY);
        let rotation = viewpoint::rotation_error_rad(&pose.rotation, &true_pose.rotation);
        (add_m / add::diameter_m(&points), rotation)
    };
    truth.cars.iter().zip(poses).map(errors).unzip()
}
