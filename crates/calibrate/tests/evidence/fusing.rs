use nalgebra::{Matrix4, Vector4};
use roadplane_base::{CameraParams, CameraStatus, JointInformation};
use roadplane_calibrate::{
    CarIdentity, CarUse, Factor, FuseOptions, Joined, Length, Survey, WindowEstimate, fuse, join,
};
use roadplane_synth::Rng;

use crate::records::SIZE;

/// Sds of a window's log focal length, tilt (rad), roll (rad) and log height.
const SD: [f64; 4] = [0.06, 0.02, 0.008, 0.05];

/// Returns the true (log focal length, tilt, roll, log height).
fn truth() -> Vector4<f64> {
    Vector4::new(1700f64.ln(), 0.4, 0.02, 9f64.ln())
}

/// Returns a window's covariance. Focal length and height are correlated, as in real windows.
fn covariance() -> Matrix4<f64> {
    let mut c = Matrix4::from_diagonal(&Vector4::from(SD).map(|sd| sd * sd));
    c[(0, 3)] = 0.9 * SD[0] * SD[3];
    c[(3, 0)] = c[(0, 3)];
    c
}

/// Returns the estimate of window `index`, 30 s long, with the covariance above.
fn window(index: usize, params: &Vector4<f64>, cars: Vec<CarUse>) -> WindowEstimate {
    WindowEstimate {
        span_s: [30.0 * index as f64, 30.0 * index as f64 + 29.0],
        frames: 900,
        params: CameraParams::from_vector(params),
        joint: JointInformation::of_camera(&covariance().try_inverse().unwrap(), params),
        cars,
        position: 0,
    }
}

/// Draws the error of a window's estimate.
fn draw(random: &mut Rng) -> Vector4<f64> {
    covariance().cholesky().unwrap().l() * Vector4::from_fn(|_, _| random.normal())
}

/// Returns parked cars with these identifiers.
fn parked(links: std::ops::Range<u64>) -> Vec<CarUse> {
    links.map(|link| CarUse { car: CarIdentity::Clip(link), parked: true }).collect()
}

/// Returns the default options for the simulated pictures.
fn options() -> FuseOptions {
    FuseOptions::for_image(SIZE)
}

#[test]
fn different_cars_add_up_and_sd_is_true() {
    let mut sum = Vector4::zeros();
    let runs = 300;
    for seed in 0..runs {
        let mut random = Rng::new(seed);
        let windows: Vec<WindowEstimate> = (0..25)
            .map(|i| window(i, &(truth() + draw(&mut random)), parked(10 * i as u64..10 * i as u64 + 10)))
            .collect();
        let fused = fuse(&windows, &options());
        assert_eq!(fused.len(), 1, "one camera, one answer");
        let sd = fused[0].covariance.diagonal().map(f64::sqrt);
        assert!((sd[0] / (SD[0] / 5.0) - 1.0).abs() < 0.35, "{}", sd[0]);
        sum += (fused[0].params.to_vector() - truth()).component_div(&sd).map(|z| z * z);
        assert_eq!((fused[0].cars_used, fused[0].frames_used), (250, 25 * 900));
        assert_eq!(fused[0].status, CameraStatus::Estimated);
    }
    let ratios = (sum / runs as f64).map(f64::sqrt);
    println!("different cars: {:.2?}", ratios.as_slice());
    assert!(ratios.iter().all(|r| (0.85..1.15).contains(r)), "{ratios}");
}

#[test]
fn the_same_parked_cars_count_once() {
    let mut sum = Vector4::zeros();
    let runs = 300;
    for seed in 0..runs {
        let mut random = Rng::new(seed);
        let shared = draw(&mut random);
        let windows: Vec<WindowEstimate> =
            (0..20).map(|i| window(i, &(truth() + shared + 0.1 * draw(&mut random)), parked(0..9))).collect();
        let fused = fuse(&windows, &options());
        assert_eq!(fused.len(), 1);
        let sd = fused[0].covariance.diagonal().map(f64::sqrt);
        assert!((sd[0] / SD[0] - 1.0).abs() < 0.1, "{}", sd[0]);
        sum += (fused[0].params.to_vector() - truth()).component_div(&sd).map(|z| z * z);
    }
    let ratios = (sum / runs as f64).map(f64::sqrt);
    println!("the same cars: {:.2?}", ratios.as_slice());
    assert!(ratios.iter().all(|r| (0.85..1.15).contains(r)), "{ratios}");
}

#[test]
fn cutting_a_clip_finer_changes_nothing() {
    let at = truth() + Vector4::new(0.03, 0.01, 0.0, 0.02);
    let one = fuse(&[window(0, &at, parked(0..9))], &options());
    let many: Vec<WindowEstimate> = (0..50).map(|i| window(i, &at, parked(0..9))).collect();
    let many = fuse(&many, &options());
    assert!((one[0].params.to_vector() - many[0].params.to_vector()).norm() < 1e-9);
    assert!((one[0].covariance - many[0].covariance).norm() < 1e-9);
}

#[test]
fn windows_that_scatter_by_more_than_they_claim_widen_it() {
    let mut random = Rng::new(2);
    let mut windows = |scatter: f64| -> Vec<WindowEstimate> {
        (0..20)
            .map(|i| {
                let at = truth() + scatter * draw(&mut random);
                window(i, &at, parked(10 * i as u64..10 * i as u64 + 10))
            })
            .collect()
    };
    let (quiet, scattered) = (windows(0.0), windows(2.0));
    let variance = |windows: &[WindowEstimate]| {
        let fused = fuse(windows, &options());
        assert_eq!(fused.len(), 1);
        fused[0].covariance[(1, 1)]
    };
    assert!(variance(&scattered) > 1.5 * variance(&quiet));
}

#[test]
fn bad_windows_do_little() {
    for seed in 0..50 {
        let mut random = Rng::new(seed);
        let windows: Vec<WindowEstimate> = (0..20)
            .map(|i| {
                let wrong = if i % 5 == 2 { Vector4::new(0.8, -0.15, 0.02, 0.7) } else { Vector4::zeros() };
                window(i, &(truth() + wrong + draw(&mut random)), parked(10 * i as u64..10 * i as u64 + 10))
            })
            .collect();
        let fused = fuse(&windows, &options());
        assert_eq!(fused.len(), 1);
        let focal = fused[0].params.log_focal - truth()[0];
        assert!(focal.abs() < 0.06, "seed {seed}: {focal}");
    }
}

#[test]
fn two_planes_share_their_focal_length_and_two_positions_share_nothing() {
    let mut random = Rng::new(1);
    let turned = truth() + Vector4::new(0.0, 0.15, 0.0, 0.0);
    let windows: Vec<WindowEstimate> = (0..12)
        .map(|i| {
            let at = if i < 6 { truth() } else { turned };
            let first = 10 * i as u64;
            let mut w = window(i, &(at + draw(&mut random)), parked(first..first + 10));
            if i >= 6 {
                w.position = 1;
            }
            w
        })
        .collect();
    let folded = FuseOptions { is_folded: true, ..options() };
    let fused = fuse(&windows, &folded);
    assert_eq!(fused.len(), 2);
    assert!(fused[0].span_s[1] < fused[1].span_s[0]);
    assert!((fused[1].params.tilt - fused[0].params.tilt - 0.15).abs() < 0.04);
    assert!((fused[1].params.log_focal - fused[0].params.log_focal).abs() < 0.04);
    let alone = fuse(&windows[6..], &options());
    assert!(fused[1].covariance[(0, 0)] < 0.8 * alone[0].covariance[(0, 0)], "the other half helps");
    // At another position of the camera, the other half does not help.
    assert!((fuse(&windows, &options())[1].covariance - alone[0].covariance).norm() < 1e-9);
}

/// Returns the horizon's distance from the principal point (px) and its sd.
fn horizon(camera: &Vector4<f64>, covariance: &Matrix4<f64>) -> [f64; 2] {
    let focal_px = camera[0].exp();
    let by = Vector4::new(focal_px * camera[1].tan(), focal_px / camera[1].cos().powi(2), 0.0, 0.0);
    [by[0], by.dot(&(covariance * by)).sqrt()]
}

#[test]
fn a_focal_length_far_from_the_cars_keeps_their_horizon() {
    // Cars determine the horizon to 1 %, but the focal length to 40 % only.
    let along = Vector4::new(1.0, -truth()[1].sin() * truth()[1].cos(), 0.0, 0.0) * 0.4;
    let rest = Matrix4::from_diagonal(&Vector4::new(1e-9, 1e-5, 1e-5, 1e-3));
    let mut cars = window(0, &truth(), parked(0..9));
    let covariance = along * along.transpose() + rest;
    cars.joint = JointInformation::of_camera(&covariance.try_inverse().unwrap(), &truth());
    let [by_cars, sd] = horizon(&truth(), &covariance);
    let factor = Factor::Survey(Survey::of_number(0, truth()[0] - 0.4, 0.01));
    let fused = &fuse(&[cars], &FuseOptions { factors: [(0, [factor].into())].into(), ..options() })[0];
    assert!((fused.params.log_focal - truth()[0] + 0.4).abs() < 0.01);
    let [joined, joined_sd] = horizon(&fused.params.to_vector(), &fused.covariance);
    assert!((joined - by_cars).abs() < 0.1 * sd, "{joined} px, by cars {by_cars} ± {sd}");
    assert!((joined_sd / sd - 1.0).abs() < 0.05, "{joined_sd} {sd}");
}

#[test]
fn without_evidence_the_prior_stays_and_is_said() {
    assert!(fuse(&[], &options()).is_empty());
    let mut nothing = window(0, &truth(), parked(0..2));
    nothing.joint = JointInformation::none();
    let fused = fuse(&[nothing.clone()], &options());
    assert_eq!(fused[0].status, CameraStatus::Unobservable);
    let sd = fused[0].covariance.diagonal().map(f64::sqrt);
    assert!((sd - options().prior_sd).norm() < 1e-9);
    // The tilt and the height are determined, the focal length is not.
    let mut weak = window(0, &truth(), parked(0..2));
    let little = Matrix4::from_diagonal(&Vector4::new(0.1, 1e4, 1e4, 1e3));
    weak.joint = JointInformation::of_camera(&little, &truth());
    assert_eq!(fuse(&[weak.clone()], &options())[0].status, CameraStatus::FocalFromPrior);
    let given = FuseOptions { focal_given: true, ..options() };
    assert_eq!(fuse(&[weak], &given)[0].status, CameraStatus::FocalGiven);
    nothing.params.tilt = f64::NAN;
    assert!(fuse(&[nothing], &options()).is_empty(), "what is no number is left out");
}

#[test]
fn factors_count_once_however_many_windows_there_are() {
    let factor = Factor::Survey(Survey::of_number(0, truth()[0] + 0.1, 0.02));
    for count in [1, 20] {
        let windows: Vec<WindowEstimate> = (0..count).map(|i| window(i, &truth(), parked(0..9))).collect();
        let options = FuseOptions { factors: [(0, [factor.clone()].into())].into(), ..options() };
        let fused = fuse(&windows, &options);
        // All windows have the same cars, so they give one Gaussian of sd `SD[0]` at the truth. The factor is a second
        // one of sd 0.02 at 0.1.
        let expected = 0.1 * SD[0].powi(2) / (SD[0].powi(2) + 0.02_f64.powi(2));
        let found = fused[0].params.log_focal - truth()[0];
        assert!((found - expected).abs() < 2e-3, "{count}: {found}, expected {expected}");
        let sd = fused[0].covariance[(0, 0)].sqrt();
        assert!((sd - 0.02 * SD[0] / SD[0].hypot(0.02)).abs() < 1e-3, "{sd}");
    }
    let elsewhere = FuseOptions { factors: [(1, [factor].into())].into(), ..options() };
    let one = [window(0, &truth(), parked(0..9))];
    assert_eq!(
        fuse(&one, &elsewhere),
        fuse(&one, &options()),
        "a factor on another position says nothing here"
    );
}

#[test]
fn what_the_cars_of_a_place_share_no_number_of_windows_averages_out() {
    // Every window measures tilt + shared elevation error, and its evidence states this.
    let windows: Vec<WindowEstimate> = (0..25)
        .map(|i| {
            let mut w = window(i, &truth(), parked(10 * i as u64..10 * i as u64 + 10));
            let information = w.joint.information;
            let cross = information.column(1).into_owned();
            w.joint.cross.column_mut(0).copy_from(&cross);
            w
        })
        .collect();
    let sd = |shared: f64| {
        let options = FuseOptions { shared_sd: [shared, 0.0, 0.0, 0.0, 0.0], ..options() };
        fuse(&windows, &options)[0].covariance[(1, 1)].sqrt()
    };
    assert!(sd(0.0) < 1.05 * SD[1] / 5.0, "{}", sd(0.0));
    assert!((sd(0.03) / 0.03_f64.hypot(SD[1] / 5.0) - 1.0).abs() < 0.02, "{}", sd(0.03));
}

/// Returns the factor of a length across the picture, with the true length in metres.
fn true_length(log_sd: f64) -> Factor {
    let ends_px = [-300.0, 250.0].map(|x| nalgebra::Vector2::new(x, 40.0));
    let length = |length_m: f64| Length { ends_px, end_sd_px: 1e-3, length_m, log_sd };
    Factor::Length(length(length(1.0).measured(&truth()).unwrap().0))
}

#[test]
fn a_length_tells_scale_and_how_large_the_cars_are() {
    // The cars are 6 % larger than the atlas's, so the camera appears to be lower.
    let by_cars = truth() - Vector4::new(0.0, 0.0, 0.0, 0.06);
    let mut seen = window(0, &by_cars, parked(0..9));
    seen.joint = JointInformation::of_camera(&(seen.joint.information * 1e4), &by_cars);
    let with = |factors: &[Factor], size_of_cars_sd: f64| {
        let factors = [(0, factors.into())].into();
        join(std::slice::from_ref(&seen), &FuseOptions { factors, size_of_cars_sd, ..options() })
    };
    let (without, told) = (with(&[], 0.04), with(&[true_length(0.01)], 0.04));
    let sd = |joined: &Joined| joined.estimates[&0].covariance[(3, 3)].sqrt();
    assert!((sd(&without) - 0.04).abs() < 1e-3 && without.size_of_cars == 0.0);
    // The prior of the cars' log size is N(0, 0.04²); the given length measures it as 0.06 ± 0.01.
    let (share, expected_sd) =
        (0.04_f64.powi(2) / (0.04_f64.powi(2) + 0.01_f64.powi(2)), 0.04 * 0.01 / 0.04_f64.hypot(0.01));
    assert!((told.size_of_cars - 0.06 * share).abs() < 1e-3, "{}", told.size_of_cars);
    assert!((sd(&told) - expected_sd).abs() < 5e-4, "{}", sd(&told));
    let height = told.estimates[&0].params.log_height - truth()[3];
    assert!((height + 0.06 * (1.0 - share)).abs() < 1e-3, "{height}");
    // If cars had exactly the atlas's sizes, the cars would determine the scale.
    assert!(with(&[true_length(0.01)], 0.0).size_of_cars.abs() < 1e-6);
}

#[test]
fn a_camera_by_cars_shares_their_error_and_a_survey_does_not() {
    let seen = window(0, &truth(), parked(0..9));
    let fused = |by_cars: bool| {
        let information = covariance().try_inverse().unwrap();
        let factor = Factor::Survey(Survey { mean: truth(), information, by_cars });
        fuse(
            std::slice::from_ref(&seen),
            &FuseOptions {
                factors: [(0, [factor.clone()].into())].into(),
                size_of_cars_sd: 0.04,
                ..options()
            },
        )
    };
    let variance = |by_cars: bool| fused(by_cars)[0].covariance[(3, 3)];
    assert!(variance(true) > 0.04_f64.powi(2) && variance(false) < variance(true), "{}", variance(true));
    assert!((variance(true) - 0.04_f64.powi(2) - SD[3].powi(2) / 2.0).abs() < 5e-5, "{}", variance(true));
}

#[test]
fn a_length_at_one_position_tells_the_size_of_cars_at_all() {
    let mut windows = [window(0, &truth(), parked(0..9)), window(1, &truth(), parked(9..18))];
    windows[1].position = 1;
    let sd = |factors: &[Factor]| {
        let factors = [(0, factors.into())].into();
        fuse(&windows, &FuseOptions { factors, size_of_cars_sd: 0.04, ..options() })[1].covariance[(3, 3)]
            .sqrt()
    };
    let by_cars = sd(&[]).powi(2) - 0.04_f64.powi(2);
    let size_sd = (sd(&[true_length(0.01)]).powi(2) - by_cars).sqrt();
    assert!(size_sd < 0.035 && size_sd > 0.01, "{size_sd}");
}
