//! Tests that information on the camera from several frames can be summed, and that shared errors are predicted.

use nalgebra::{Matrix4, Point3, Vector3, Vector4};
use roadplane_base::{Camera, CameraParams, Keypoint, Lens, SHARED_ERRORS, ShapeAtlas};
use roadplane_solve::{
    CameraPrior, CarView, GivenScene, OutlierModel, SceneOptions, SceneSolution, Steps, ViewErrors,
    refine_scene, solve_scene,
};
use roadplane_synth::{SceneTruth, SynthOptions, scene};

#[test]
fn view_errors_widen_the_covariance() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let scene = scene(&atlas, &SynthOptions { cars: 8, noise: 0.01, ..SynthOptions::default() }, 11);
    let views = CarView::each(scene.keypoints());
    for given_focal_px in [None, Some(scene.params.focal_px())] {
        let solve = |view_errors: Option<ViewErrors>| {
            let camera_prior = CameraPrior::none();
            let options =
                SceneOptions { camera_prior, given_focal_px, view_errors, ..SceneOptions::default() };
            solve_scene(&atlas, scene.size, &views, &options)
        };
        let errors = |keypoints_as_one: f64, shared: f64| {
            Some(ViewErrors {
                keypoints_as_one,
                mean_elevation: 0.0,
                shared_sd: [shared, shared, 0.0, 0.0, 0.0],
            })
        };
        let sd = |found: &SceneSolution| found.covariance.diagonal().map(f64::sqrt);
        let none = solve(None);
        assert!((none.params.to_vector() - solve(errors(5.0, 0.02)).params.to_vector()).amax() < 1e-6);
        let (own, shared) = (sd(&solve(errors(5.0, 0.0))), sd(&solve(errors(5.0, 0.02))));
        let none = sd(&none);
        for i in (0..4).filter(|i| none[*i] > 0.0) {
            assert!(none[i] < own[i] && own[i] < shared[i], "{i}: {none} {own} {shared}");
        }
        // If the focal length is given, the whole shared error goes into the tilt.
        assert!(given_focal_px.is_none() || shared[1] > 0.9 * 0.02, "{shared}");
        assert_eq!(given_focal_px.is_some(), shared[0] == 0.0);
    }
}

/// All cars appear as if they were seen from a steeper direction. The correction expects this of cars seen from the front
/// or rear, so it removes a part of the change of the camera.
#[test]
fn an_expected_error_of_the_elevation_is_removed() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let error = 0.5_f64.to_radians();
    let solve = |error: f64, expected: f64| {
        let options =
            SynthOptions { cars: 12, noise: 0.01, view_off: [error, 0.0], ..SynthOptions::default() };
        let scene = scene(&atlas, &options, 5);
        let view_errors =
            ViewErrors { keypoints_as_one: 1.0, mean_elevation: expected, shared_sd: [0.0; SHARED_ERRORS] };
        let (camera_prior, view_errors) = (CameraPrior::none(), Some(view_errors));
        let steps = Steps { bias: false, body_types: false, ..Steps::default() };
        let options = SceneOptions { camera_prior, view_errors, steps, ..SceneOptions::default() };
        let found = solve_scene(&atlas, scene.size, &CarView::each(scene.keypoints()), &options);
        found.params.to_vector()
    };
    // Errors of both signs, so that all scenes have the same noise.
    let [flat, steep, corrected] = [solve(-error, 0.0), solve(error, 0.0), solve(error, 2.0 * error)];
    for number in 0..2 {
        let [before, after] = [steep, corrected].map(|camera| (camera - flat)[number].abs());
        assert!(before > 5e-3 && after < 0.8 * before, "{number}: {before} {after}");
    }
}

/// The cross information predicts how much the camera changes if the lens distortion is wrong.
#[test]
fn an_error_of_the_lens_moves_the_camera_as_predicted() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let scene = scene(&atlas, &SynthOptions { cars: 12, noise: 0.02, ..SynthOptions::default() }, 4);
    let views = CarView::each(scene.keypoints());
    let steps = Steps { bias: false, body_types: false, ..Steps::default() };
    let view_errors =
        Some(ViewErrors { keypoints_as_one: 1.0, mean_elevation: 0.0, shared_sd: [0.0; SHARED_ERRORS] });
    let solve = |distortion: f64| {
        let lens = Lens::with_distortion(distortion, scene.size);
        let camera_prior = CameraPrior::none();
        let options = SceneOptions { camera_prior, lens, view_errors, steps, ..SceneOptions::default() };
        solve_scene(&atlas, scene.size, &views, &options)
    };
    const DISTORTION: f64 = 0.004;
    let straight = solve(0.0);
    let moved = (solve(DISTORTION).params.to_vector() - solve(-DISTORTION).params.to_vector()) / 2.0;
    let joint = straight.information;
    let by_lens = -joint.information.try_inverse().unwrap() * joint.cross.column(2);
    let predicted = by_lens * Lens::with_distortion(DISTORTION, scene.size).per_px2;
    assert!((moved - predicted).amax() < 0.15 * moved.amax() && moved.amax() > 1e-3, "{moved} {predicted}");
}

#[test]
fn a_hundred_frames_determine_the_focal_length() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let options = SceneOptions::default();
    let mut errors = Vec::new();
    for (ratio, height, tilt) in [(0.8, 6.0, 0.35), (1.3, 10.0, 0.45), (2.5, 20.0, 0.3)] {
        let asked = SynthOptions {
            cars: 10,
            noise: 0.02,
            focal_ratio: [ratio; 2],
            height_m: [height; 2],
            tilt: [tilt; 2],
            roll: [0.01; 2],
            box_px: [40.0, 700.0],
            ..SynthOptions::default()
        };
        let prior = options.camera_prior.information();
        let mut information = Matrix4::from_diagonal(&prior);
        let mut vector: Vector4<f64> = Vector4::zeros();
        let mut truth = None;
        for frame in 0..100 {
            let scene = scene(&atlas, &asked, 5000 + frame);
            let views = CarView::each(scene.keypoints());
            let found = solve_scene(&atlas, scene.size, &views, &options);
            if frame == 0 {
                vector = options.camera_prior.mean(scene.size).to_vector().component_mul(&prior);
            }
            let (own, own_vector) = found.information.marginal([0.0; SHARED_ERRORS]);
            information += own;
            vector += own_vector;
            truth = Some(scene.params);
        }
        let covariance = information.cholesky().unwrap().inverse();
        let fused = CameraParams::from_vector(&(covariance * vector));
        let off = fused.log_focal - truth.unwrap().log_focal;
        println!(
            "focal {:.0}: off {:+.2} %, reported sd {:.2} %",
            fused.focal_px(),
            100.0 * off,
            100.0 * covariance[(0, 0)].sqrt()
        );
        errors.push(off.abs());
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[1] < 0.015, "median {}", errors[1]);
}

/// Returns four variants of a scene: both signs of the noise, and both signs of the cars' deviations from the mean car.
///
/// First-order effects of noise and shapes cancel over the four variants, so only the bias remains.
fn mirrored(atlas: &ShapeAtlas, truth: &SceneTruth) -> Vec<SceneTruth> {
    let camera = Camera::centred(truth.params.focal_px(), truth.size);
    let camera_from_world = truth.params.plane().camera_from_world();
    let variant = |[by_shape, by_noise]: [f64; 2]| {
        let mut scene = truth.clone();
        for car in &mut scene.cars {
            let camera_from_car = camera_from_world * car.pose.world_from_car();
            let seen =
                |p: Vector3<f64>| camera.pixel_from_camera(&(camera_from_car * Point3::from(p)).coords);
            for (i, point) in car.keypoints_in_car.iter().enumerate() {
                let other = atlas.mean[i] + (point - atlas.mean[i]) * by_shape;
                car.keypoints[i] = car.keypoints[i].and_then(|keypoint| {
                    let noise = keypoint.pixel - seen(*point)?;
                    Some(Keypoint { pixel: seen(other)? + noise * by_noise, ..keypoint })
                });
            }
            car.shape *= by_shape;
        }
        scene
    };
    [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]].map(variant).to_vec()
}

#[test]
fn sums_of_frames_have_no_bias() {
    let atlas = ShapeAtlas::shipped().unwrap();
    let errors = |bias: bool| {
        // Body types and car weights are switched off, because they make the problem non-Gaussian.
        let steps = Steps { bias, body_types: false, trust: false, ..Steps::default() };
        let options = SceneOptions { steps, kernel: OutlierModel::none(), ..SceneOptions::default() };
        let (mut sums, mut cameras) = (Vector4::<f64>::zeros(), 0.0);
        for (tilt, focal_ratio) in [(0.35, 1.0), (0.35, 1.8), (0.6, 1.2), (0.6, 2.0)] {
            let [tilt, focal_ratio, height_m, roll] = [tilt, focal_ratio, 15.0, 0.0].map(|v| [v; 2]);
            let asked = SynthOptions {
                tilt,
                focal_ratio,
                height_m,
                roll,
                noise: 0.01,
                off_atlas: 1.0,
                ..SynthOptions::default()
            };
            let prior = options.camera_prior.information();
            let mut information = Matrix4::from_diagonal(&prior);
            let mut vector = options.camera_prior.mean(asked.size).to_vector().component_mul(&prior);
            let mut truth = Vector4::zeros();
            for seed in 0..6 {
                for scene in mirrored(&atlas, &scene(&atlas, &asked, 700 + seed)) {
                    let (poses, shapes): (Vec<_>, Vec<_>) =
                        scene.cars.iter().map(|car| (car.pose, car.shape)).unzip();
                    let from = GivenScene { params: scene.params, poses: &poses, shapes: &shapes };
                    let views = CarView::each(scene.keypoints());
                    let found = refine_scene(&atlas, scene.size, &views, &from, &options).unwrap();
                    let (own, own_vector) = found.information.marginal(options.shared_sd());
                    (information, vector) = (information + own, vector + own_vector);
                    truth = scene.params.to_vector();
                }
            }
            sums += information.cholesky().unwrap().solve(&vector) - truth;
            cameras += 1.0;
        }
        sums / cameras
    };
    let (with, without) = (errors(true), errors(false));
    println!("mean errors of (log f, tilt, roll, log h): with bias correction {with}, without {without}");
    // Only tilt and height are checked, because these few scenes do not determine the focal length well enough.
    for number in [1, 3] {
        assert!(with[number].abs() < 0.4 * without[number].abs(), "{number}: {with} {without}");
    }
}
