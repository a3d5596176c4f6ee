use roadplane_base::{KEYPOINTS, KeypointSet};
use roadplane_calibrate::combine;
use roadplane_synth::Rng;

use crate::records::{frame, still};

/// Returns `n` observations of one stationary car. The predicted sd is 4 px; the actual noise has `white` times this
/// sd.
fn looks(n: u64, white: f64, random: &mut Rng) -> Vec<KeypointSet> {
    (0..n)
        .filter_map(|i| {
            frame(i, i as f64, &[still(100.0, 100.0, 200.0)], 4.0, white, random).cars[0]
                .keypoints
                .as_deref()
                .copied()
        })
        .collect()
}

/// Returns the sd of keypoint 3 after combining (px), and the scatter ratio. The bias share is 0.5.
fn sd(sets: &[KeypointSet]) -> (f64, Option<f64>) {
    let combined = combine(&sets.iter().collect::<Vec<_>>(), 0.5);
    (combined.keypoints[3].unwrap().sd_px(), combined.scatter_ratio)
}

#[test]
fn white_noise_averages_down_to_the_stated_bias() {
    let (sd, ratio) = sd(&looks(100, 1.0, &mut Rng::new(1)));
    // Half of 4 px remains as bias whatever the scatter is; the rest falls to a tenth.
    assert!((sd - (2.0f64.powi(2) + 0.4f64.powi(2)).sqrt()).abs() < 0.15, "{sd} px");
    assert!((ratio.unwrap() - 1.0).abs() < 0.1, "{ratio:?}");
}

#[test]
fn what_does_not_scatter_is_bias() {
    let (sd, ratio) = sd(&looks(100, 0.2, &mut Rng::new(2)));
    assert!((sd - 4.0 * (1.0f64 - 0.04).sqrt()).abs() < 0.1, "{sd} px");
    assert!((ratio.unwrap() - 0.04).abs() < 0.01, "{ratio:?}");
}

#[test]
fn scatter_beyond_the_prediction_widens_it() {
    let one = looks(1, 3.0, &mut Rng::new(3));
    let (sd_one, none) = sd(&one);
    assert!((sd_one - 4.0).abs() < 1e-9 && none.is_none());
    let (sd_few, ratio) = sd(&looks(4, 3.0, &mut Rng::new(3)));
    assert!(ratio.unwrap() > 4.0 && sd_few > 4.0, "{sd_few} px, {ratio:?}");
}

#[test]
fn every_fourth_look_far_off_does_little() {
    let mut sets = looks(40, 0.5, &mut Rng::new(4));
    for set in sets.iter_mut().step_by(4) {
        set.iter_mut().flatten().for_each(|p| p.pixel.x += 60.0);
    }
    let combined = combine(&sets.iter().collect::<Vec<_>>(), 0.5);
    let truth = 100.0 + 200.0 * 3.5 / 6.0;
    assert!((combined.keypoints[3].unwrap().pixel.x - truth).abs() < 2.0);
}

#[test]
fn keypoints_seen_rarely_are_left_out() {
    let mut sets = looks(10, 1.0, &mut Rng::new(5));
    sets.iter_mut().skip(2).for_each(|set| set[3] = None);
    let combined = combine(&sets.iter().collect::<Vec<_>>(), 0.5);
    assert!(combined.keypoints[3].is_none());
    assert_eq!(combined.keypoints.iter().flatten().count(), KEYPOINTS / 2 - 1);
    assert!(combine(&[], 0.5).keypoints.iter().all(Option::is_none));
}
