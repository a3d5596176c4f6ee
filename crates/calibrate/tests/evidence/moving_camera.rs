use nalgebra::Vector2;
use roadplane_base::FrameRecord;
use roadplane_calibrate::{EvidenceBuilder, MoveDetector, MoveState, SegmentStart, Window};
use roadplane_synth::Rng;

use crate::records::{Moving, frame, rows, still};

/// Returns the boxes after a scaling about the picture's centre and a shift, px.
fn shifted(cars: &[Moving], shift: [f64; 2], scale: f64) -> Vec<Moving> {
    let move_x = |x: f64| (x - 960.0) * scale + 960.0 + shift[0];
    let move_y = |y: f64| (y - 540.0) * scale + 540.0 + shift[1];
    cars.iter()
        .map(|car| {
            let [x0, y0, x1, y1] = car.bbox_px;
            Moving { bbox_px: [move_x(x0), move_y(y0), move_x(x1), move_y(y1)], ..*car }
        })
        .collect()
}

/// Returns 100 frames at 25 frames/s, with the cars `before` up to frame 49 and the cars `then` from frame 50.
fn clip(before: &[Moving], then: &[Moving], seed: u64) -> Vec<FrameRecord> {
    let mut random = Rng::new(seed);
    (0..100)
        .map(|i| {
            let cars = if i < 50 { before } else { then };
            let mut record = frame(i, i as f64 / 25.0, cars, 2.0, 1.0, &mut random);
            record.cars.retain(|_| random.unit() > 0.15);
            record
        })
        .collect()
}

/// Cuts the frames into windows of 1 s.
fn windows(frames: &[FrameRecord]) -> Vec<Window> {
    let mut builder = EvidenceBuilder::new(1.0);
    let mut found: Vec<Window> = frames.iter().filter_map(|f| builder.push(f.clone())).collect();
    found.extend(builder.finish());
    found
}

#[test]
fn a_turned_camera_starts_a_segment_at_the_right_frame() {
    let cars = rows(5);
    for (shift, scale) in
        [([12.0, 5.0], 1.0), ([150.0, -40.0], 1.0), ([-330.0, 60.0], 1.0), ([0.0, 0.0], 1.3)]
    {
        for seed in 0..5 {
            let windows = windows(&clip(&cars, &shifted(&cars, shift, scale), seed));
            let starts: Vec<&Window> = windows.iter().filter(|w| w.segment == 1).collect();
            assert_eq!(windows.iter().map(|w| w.segment).max(), Some(1), "{shift:?} {scale}");
            assert!((starts[0].span_s[0] - 2.0).abs() < 1e-9, "{shift:?} {scale}: {:?}", starts[0].span_s);
            let SegmentStart::Moved { log_scale } = starts[0].start else { panic!("{:?}", starts[0].start) };
            assert!((log_scale - scale.ln()).abs() < 0.02, "{log_scale}");
            assert_eq!(windows.iter().map(|w| w.frames).sum::<usize>(), 100, "no frame is lost");
        }
    }
}

#[test]
fn another_scene_is_a_cut() {
    let other: Vec<Moving> = (0..6)
        .map(|i| still(100.0 + 290.0 * f64::from(i * i % 7), 60.0 + 170.0 * f64::from(i), 80.0))
        .collect();
    let windows = windows(&clip(&rows(5), &other, 1));
    let start = windows.iter().find(|w| w.segment == 1).unwrap();
    assert_eq!(start.start, SegmentStart::Cut);
    assert!((start.span_s[0] - 2.0).abs() < 1e-9);
}

#[test]
fn a_still_camera_is_one_segment_though_cars_leave_and_one_frame_shakes() {
    let cars = rows(5);
    for seed in 0..10 {
        let mut frames = clip(&cars, &cars[3..], seed);
        for car in frames.iter_mut().skip(70).take(2).flat_map(|frame| &mut frame.cars) {
            car.bbox_px = car.bbox_px.map(|x| x + 9.0);
        }
        let windows = windows(&frames);
        assert!(windows.iter().all(|w| w.segment == 0 && w.start == SegmentStart::Clip));
        assert_eq!(windows.iter().map(|w| w.frames).sum::<usize>(), 100);
        assert!(windows[1..].iter().all(|w| w.steady) && !windows[0].steady);
    }
}

#[test]
fn slow_drift_is_seen_by_its_sum() {
    let mut random = Rng::new(3);
    let mut detector = MoveDetector::default();
    let cars: Vec<Moving> =
        rows(5).into_iter().map(|car| Moving { velocity_px_s: [1.0, 0.0], ..car }).collect();
    let states: Vec<MoveState> =
        (0..600).map(|i| detector.push(&frame(i, i as f64 / 10.0, &cars, 2.0, 1.0, &mut random))).collect();
    let moves = states.iter().filter(|s| matches!(s, MoveState::Moved(_))).count();
    assert!((2..=9).contains(&moves), "{moves} moves in 60 px");
    let Some(MoveState::Steady { shift_px }) = states.get(40) else { panic!("{:?}", states.get(40)) };
    assert!((shift_px - Vector2::new(3.0, 0.0)).norm() < 1.5, "{shift_px}");
}

#[test]
fn few_cars_tell_nothing() {
    let mut random = Rng::new(3);
    let mut detector = MoveDetector::default();
    for i in 0..40 {
        let cars = shifted(
            &[still(300.0, 300.0, 100.0), still(800.0, 300.0, 100.0)],
            [if i < 20 { 0.0 } else { 50.0 }, 0.0],
            1.0,
        );
        assert_eq!(
            detector.push(&frame(i, i as f64 / 10.0, &cars, 2.0, 1.0, &mut random)),
            MoveState::Unknown
        );
    }
}
