//! Tests of epochs on clips of one camera, in any order.

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{CameraEvidence, ClipIdentity, EVIDENCE_SCHEMA, KEYPOINTS, ParkedCar};
use roadplane_calibrate::{FuseOptions, SameView, epochs, fuse, joins, same_vehicle};
use roadplane_synth::Rng;

use crate::records::SIZE;

/// Sds of a clip's log focal length, tilt (rad), roll (rad) and log height.
const SD: [f64; 4] = [0.05, 0.01, 0.005, 0.04];

/// Returns the true (log focal length, tilt, roll, log height).
fn truth() -> Vector4<f64> {
    Vector4::new(1700f64.ln(), 0.4, 0.02, 9f64.ln())
}

/// Returns a parked vehicle with a shape of its own at a position in the picture, px.
fn vehicle(seed: u64, at: Vector2<f64>, noise_px: f64, random: &mut Rng) -> ParkedCar {
    let mut shape = Rng::new(seed);
    let keypoints_px = (0..KEYPOINTS)
        .map(|i| {
            let own = Vector2::new((i % 6) as f64 * 20.0, (i / 6) as f64 * 10.0)
                + Vector2::new(shape.normal(), shape.normal()) * 5.0;
            let pixel = at + own + Vector2::new(random.normal(), random.normal()) * noise_px;
            (i % 3 != 0).then_some([pixel.x, pixel.y])
        })
        .collect();
    ParkedCar { bbox_px: [at.x - 5.0, at.y - 5.0, at.x + 105.0, at.y + 55.0], keypoints_px }
}

/// Returns the evidence of the clip of one night, with the estimate `at`.
fn clip(night: usize, at: Vector4<f64>, parked: Vec<ParkedCar>) -> CameraEvidence {
    let information = Matrix4::from_diagonal(&Vector4::from(SD).map(|sd| 1.0 / (sd * sd)));
    CameraEvidence {
        schema: EVIDENCE_SCHEMA.to_owned(),
        camera: "c".to_owned(),
        clip: ClipIdentity {
            recorded: format!("2026-01-{night:02}T22:00:00"),
            sha256: format!("{night}"),
            name: format!("night-{night}"),
        },
        models: Vec::new(),
        image_size_px: SIZE,
        span_s: [0.0, 60.0],
        frames: 1500,
        params: std::array::from_fn(|i| at[i]),
        information: std::array::from_fn(|r| std::array::from_fn(|c| information[(r, c)])),
        shared: [[0.0; roadplane_base::SHARED_ERRORS]; 4],
        lens: None,
        parked,
        moving: 2,
        place: None,
    }
}

/// Draws the error of a clip's estimate.
fn draw(random: &mut Rng) -> Vector4<f64> {
    Vector4::from_fn(|i, _| SD[i] * random.normal())
}

/// Compares no pictures.
fn unknown(_: &CameraEvidence, _: &CameraEvidence) -> SameView {
    SameView::Unknown
}

/// Returns the default options for the simulated pictures.
fn options() -> FuseOptions {
    FuseOptions::for_image(SIZE)
}

#[test]
fn nights_of_other_cars_add_up_and_the_same_cars_count_once() {
    let mut random = Rng::new(1);
    let place = Vector2::new(300.0, 200.0);
    let others: Vec<_> = (1..=25)
        .map(|night| {
            clip(night, truth() + draw(&mut random), vec![vehicle(night as u64, place, 0.5, &mut random)])
        })
        .collect();
    let own = vehicle(99, place, 0.0, &mut random);
    let same: Vec<_> = (1..=25)
        .map(|night| CameraEvidence { moving: 0, ..clip(night, truth(), vec![own.clone()]) })
        .collect();
    let sd = |clips: &[CameraEvidence]| {
        let known = epochs(clips, &unknown, &options());
        assert_eq!(known.len(), 1);
        let fused = fuse(&known[0].windows, &options());
        assert_eq!(fused.len(), 1);
        (fused[0].covariance[(0, 0)].sqrt(), fused[0].params.log_focal - truth()[0])
    };
    let (apart, off) = sd(&others);
    assert!((apart / (SD[0] / 5.0) - 1.0).abs() < 0.3, "{apart}");
    assert!(off.abs() < 4.0 * apart);
    let (together, _) = sd(&same);
    assert!((together / SD[0] - 1.0).abs() < 0.05, "{together}");
}

#[test]
fn the_order_in_which_clips_come_does_not_matter() {
    let mut random = Rng::new(2);
    let turned = Vector4::new(0.0, 0.2, 0.0, 0.0);
    let mut clips: Vec<_> = (1..=20)
        .map(|night| {
            let at = truth() + draw(&mut random) + if night > 12 { turned } else { Vector4::zeros() };
            clip(night, at, vec![vehicle(night as u64 % 3, Vector2::new(100.0, 100.0), 0.3, &mut random)])
        })
        .collect();
    // One clip was processed twice. Its later result counts, whatever the order.
    let mut again = clips[4].clone();
    again.clip.recorded.push('z');
    clips.push(again);
    let bits = |clips: &[CameraEvidence]| -> Vec<Vec<u64>> {
        let known = epochs(clips, &unknown, &options());
        assert_eq!(known.iter().map(|epoch| epoch.clips.len()).collect::<Vec<_>>(), [12, 8]);
        let estimates = known.iter().flat_map(|epoch| fuse(&epoch.windows, &options()));
        estimates
            .map(|e| e.covariance.iter().chain(&e.params.to_vector()).map(|v| v.to_bits()).collect())
            .collect()
    };
    let expected = bits(&clips);
    for _ in 0..100 {
        for i in (1..clips.len()).rev() {
            clips.swap(i, (random.unit() * (i + 1) as f64) as usize);
        }
        assert_eq!(bits(&clips), expected);
    }
}

#[test]
fn pictures_decide_where_they_speak() {
    let mut random = Rng::new(3);
    let clips: Vec<_> = (1..=6).map(|night| clip(night, truth() + draw(&mut random), Vec::new())).collect();
    let night_of = |e: &CameraEvidence| e.clip.sha256.parse::<u32>().unwrap();
    // The camera was turned after the third night and back after the fifth. The numbers alone would not show it.
    let view = |e: &CameraEvidence| (4..=5).contains(&night_of(e));
    let compare = |a: &CameraEvidence, b: &CameraEvidence| {
        if view(a) == view(b) { SameView::Same } else { SameView::Moved }
    };
    let known = epochs(&clips, &compare, &options());
    let nights: Vec<Vec<u32>> =
        known.iter().map(|epoch| epoch.clips.iter().map(|e| night_of(e)).collect()).collect();
    assert_eq!(nights, [vec![1, 2, 3, 6], vec![4, 5]]);
    // Pictures of another size belong to another camera, whatever the numbers are.
    let mut zoomed = clip(7, truth(), Vec::new());
    zoomed.image_size_px.width += 1;
    assert_eq!(joins(&zoomed, &known, &unknown, &options()), None);
}

#[test]
fn a_clip_that_says_nothing_contradicts_nothing() {
    let mut random = Rng::new(4);
    let clips: Vec<_> = (1..=6).map(|night| clip(night, truth() + draw(&mut random), Vec::new())).collect();
    let known = epochs(&clips, &unknown, &options());
    let mut empty = clip(7, Vector4::zeros(), Vec::new());
    empty.information = [[0.0; 4]; 4];
    assert_eq!(joins(&empty, &known, &unknown, &options()), Some(0));
    let turned = clip(8, truth() + Vector4::new(0.0, 10.0 * SD[1], 0.0, 0.0), Vec::new());
    assert_eq!(joins(&turned, &known, &unknown, &options()), None);
}

#[test]
fn vehicles_are_distinguished_by_place_and_shape() {
    let mut random = Rng::new(5);
    let at = Vector2::new(400.0, 300.0);
    for seed in 0..50 {
        let first = vehicle(seed, at, 0.5, &mut random);
        // One vehicle left and returned to about the same position. Another vehicle took the bay. The first vehicle is
        // one bay further.
        let back = vehicle(seed, at + Vector2::new(4.0, -3.0), 0.5, &mut random);
        let other = vehicle(seed + 1000, at, 0.5, &mut random);
        let further = vehicle(seed, at + Vector2::new(100.0, 0.0), 0.5, &mut random);
        assert!(same_vehicle(&first, &back) && same_vehicle(&back, &first));
        assert!(!same_vehicle(&first, &other) && !same_vehicle(&first, &further));
    }
}
