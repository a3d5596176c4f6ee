//! Calibration of uncertainties: reported sds against true errors.

use roadplane_base::angle_difference;
use roadplane_measure::POSE_SD_RATIO;

use crate::{
    parked::lot,
    world::{Seeing, World, owners, pose, straight, times, track},
};

/// Returns the normalised error of x, y and heading over many worlds (rms of the error divided by its sd).
fn normalised(worlds: impl Iterator<Item = World>) -> [f64; 3] {
    let (mut sums, mut count) = ([0.0; 3], 0.0);
    for world in worlds {
        let seen = world.see();
        let tracks = track(&seen.frames);
        for (track, owner) in tracks.iter().zip(owners(&tracks, &seen)) {
            let Some(car) = owner else { continue };
            let state = &track.states[track.states.len() / 2];
            let truth = world.truth(car, &state.stamp).unwrap();
            let errors = [
                state.pose.x_m - truth.x_m,
                state.pose.y_m - truth.y_m,
                angle_difference(state.pose.heading_rad, truth.heading_rad),
            ];
            for i in 0..3 {
                sums[i] += (errors[i] / state.pose_sd[i]).powi(2);
            }
            count += 1.0;
        }
    }
    sums.map(|sum| (sum / count).sqrt())
}

/// Returns the usual quality of detections, without false alarms and flipped headings. The keypoints of one crop share a
/// part of their errors.
fn clean() -> Seeing {
    Seeing { false_alarms: 0.0, flipped: 0.0, sd_ratio: POSE_SD_RATIO, ..Seeing::usual() }
}

#[test]
fn sd_of_parked_cars_is_true() {
    // The tracker does not get the share of bias. The scatter shows it.
    for bias in [0.4, 0.7, 0.95] {
        let worlds =
            (0..40).map(|seed| World::new(lot(), Seeing { bias, ..clean() }, times(3.0, 15.0), seed));
        let ratios = normalised(worlds);
        println!("parked, bias {bias}: {ratios:.2?}");
        assert!(ratios.iter().all(|r| (0.75..1.25).contains(r)), "bias {bias}: {ratios:?}");
    }
}

#[test]
fn sd_of_driving_cars_is_true() {
    let worlds = (0..200).map(|seed| {
        let speed = 3.0 + f64::from(u32::try_from(seed % 7).unwrap());
        World::new(vec![straight(pose(-9.0, 22.0, 0.05), speed)], clean(), times(1.8, 25.0), seed)
    });
    let ratios = normalised(worlds);
    println!("driving: {ratios:.2?}");
    assert!(ratios[..2].iter().all(|r| (0.75..1.25).contains(r)), "{ratios:?}");
    // The path corrects a bias of the heading. The sd includes this only in part.
    assert!((0.3..1.25).contains(&ratios[2]), "{ratios:?}");
}

#[test]
fn keypoints_that_fit_badly_widen_the_sd() {
    let world = World::new(lot(), Seeing { bias: 0.7, ..clean() }, times(3.0, 15.0), 5);
    let sd = |misfit: f64| {
        let mut frames = world.see().frames;
        for car in frames.iter_mut().flat_map(|frame| &mut frame.cars) {
            car.fit_rms_share = car.fit_rms_share.map(|share| misfit * share);
        }
        track(&frames)[0].states[0].pose_sd.norm()
    };
    // A better fit than usual is luck. Twice the usual distances mean that the keypoints may be on another car.
    assert!((sd(0.5) - sd(1.0)).abs() < 1e-9, "{} {}", sd(0.5), sd(1.0));
    assert!(sd(2.0) > 2.0 * sd(1.0) && sd(2.0) < 5.0 * sd(1.0), "{} {}", sd(2.0), sd(1.0));
}

#[test]
fn more_frames_do_not_shrink_what_is_bias() {
    let sd = |seconds: f64| {
        let world = World::new(lot(), Seeing { bias: 0.5, ..clean() }, times(seconds, 15.0), 3);
        track(&world.see().frames)[0].states[0].pose_sd.norm()
    };
    let (short, long) = (sd(2.0), sd(40.0));
    assert!(long > 0.8 * short && long < 1.1 * short, "{short} then {long}");
}
