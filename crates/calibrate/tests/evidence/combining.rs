use roadplane_base::{KEYPOINTS, KeypointSet};
use roadplane_calibrate::combine;
use roadplane_synth::Rng;

use crate::records::{frame, still};

/// Returns `n` observations of one stationary car. The predicted sd is 4 px; the actual noise has `white` times this
/// sd.
fn observations(n: u64, white: f64, random: &mut Rng) -> Vec<KeypointSet> {
    (0..n)
        .filter_map(|i| {
            frame(i, i as f64, &[still(100.0, 100.0, 200.0)], 4.0, white, random).cars[0]
                .keypoints
                .as_deref()
                .copied()
        })
        .collect()
}

fn combined(sets: &[KeypointSet]) -> Box<KeypointSet> {
    combine(&sets.iter().collect::<Vec<_>>())
}

/// Returns the sd of keypoint 3 after combining, px.
fn sd(sets: &[KeypointSet]) -> f64 {
    combined(sets)[3].unwrap().sd_px()
}

#[test]
fn the_mean_keeps_the_bias_of_one_observation() {
    for white in [0.2, 1.0] {
        let sets = observations(100, white, &mut Rng::new(1));
        assert!((sd(&sets) - 4.0).abs() < 0.05, "{} px", sd(&sets));
        let off = combined(&sets)[3].unwrap().pixel
            - combined(&observations(1, 0.0, &mut Rng::new(1)))[3].unwrap().pixel;
        assert!(off.norm() < 4.0 * white * 0.4, "the mean has less white noise: {off}");
    }
}

#[test]
fn scatter_beyond_the_prediction_widens_it() {
    let [one, few] = [1, 4].map(|n| sd(&observations(n, 3.0, &mut Rng::new(3))));
    // The scatter of the four observations is more than four times the prediction.
    let least = 4.0 * (1.0 + 4.0 / 4.0_f64).sqrt();
    assert!((one - 4.0).abs() < 1e-9 && few > least, "{one} and {few} px");
}

#[test]
fn every_fourth_observation_far_off_does_little() {
    let mut sets = observations(40, 0.5, &mut Rng::new(4));
    for set in sets.iter_mut().step_by(4) {
        set.iter_mut().flatten().for_each(|p| p.pixel.x += 60.0);
    }
    let truth = 100.0 + 200.0 * 3.5 / 6.0;
    assert!((combined(&sets)[3].unwrap().pixel.x - truth).abs() < 2.0);
    assert!(sd(&sets) < 4.5, "{} px", sd(&sets));
}

#[test]
fn a_quarter_of_the_frames_that_another_car_hides_does_little() {
    let mut sets = observations(40, 0.5, &mut Rng::new(4));
    for set in sets.iter_mut().skip(12).take(10) {
        set.iter_mut().flatten().for_each(|p| p.pixel.x += 60.0);
    }
    assert!(sd(&sets) < 9.0, "{} px", sd(&sets));
}

#[test]
fn keypoints_that_most_frames_lack_are_left_out() {
    let mut sets = observations(10, 1.0, &mut Rng::new(5));
    sets.iter_mut().skip(4).for_each(|set| set[3] = None);
    sets.iter_mut().skip(5).for_each(|set| set[4] = None);
    let found = combined(&sets);
    assert!(found[3].is_none() && found[4].is_some());
    assert_eq!(found.iter().flatten().count(), KEYPOINTS / 2 - 1);
    assert!(combined(&[]).iter().all(Option::is_none));
}
