use std::sync::Arc;

use roadplane_base::{
    FrameRecord, Lens, NotFollowedReason, PictureVerdict, Registration, SceneLine, WatchRecord,
};
use roadplane_calibrate::{OneCamera, Places, PlacesBuilder};
use roadplane_synth::Rng;

use crate::records::{frame, rows};

/// Returns a registration on a reference whose picture is shifted to the right.
fn shifted(reference: u64, shift_px: f64) -> Registration {
    let homography = Some([1.0, 0.0, shift_px, 0.0, 1.0, 0.0, 0.0, 0.0]);
    Registration { reference, homography, sd_px: 0.1, lens: None }
}

/// Returns a frame with four cars and a scene line, at 10 frames/s.
fn record(number: u64, motion: Vec<Registration>, verdict: PictureVerdict) -> FrameRecord {
    let watch = WatchRecord { looked: true, motion, verdict, ..WatchRecord::default() };
    FrameRecord {
        watch: Some(watch),
        scene_lines: Some(vec![SceneLine::from([10.0, 0.0, 10.0, 50.0, 0.01])]),
        ..frame(number, number as f64 / 10.0, &rows(2), 2.0, 1.0, &mut Rng::new(number))
    }
}

fn places(frames: &[FrameRecord]) -> Places {
    let mut builder = PlacesBuilder::new(Lens::STRAIGHT, [0.0; 2]);
    frames.iter().for_each(|frame| builder.push(frame));
    builder.finish()
}

/// Returns the frames as those of one camera.
fn converted(frames: Vec<FrameRecord>) -> Vec<FrameRecord> {
    let places = Arc::new(places(&frames));
    OneCamera::new(frames.into_iter().map(Ok::<_, ()>), places).map(Result::unwrap).collect()
}

#[test]
fn a_view_too_short_for_a_place_is_lost_and_says_so() {
    // A view of one second, a view of four seconds, and another one of a second, with cuts between them.
    let reference = |i: u64| [0, 10, 50][usize::from(i >= 10) + usize::from(i >= 50)];
    let view = |i: u64| record(i, vec![shifted(reference(i), 0.0)], PictureVerdict::Rest);
    let frames = converted((0..60).map(view).collect());
    let of = |frame: &FrameRecord| {
        let watch = frame.watch.as_ref().unwrap();
        (frame.cars.len(), frame.scene_lines.is_some(), watch.left_out)
    };
    assert_eq!(frames.len(), 60);
    for (i, frame) in frames.iter().enumerate() {
        let expected = match !(10..50).contains(&i) {
            true => (0, false, Some(NotFollowedReason::NotRegistered)),
            false => (4, true, None),
        };
        assert_eq!(of(frame), expected, "frame {i}");
    }
}

#[test]
fn cars_are_put_into_the_first_picture_of_their_place() {
    // The camera turns by 2 px a frame for three seconds. Then it looks elsewhere.
    let view = |i: u64| match i < 30 {
        true => record(i, vec![shifted(0, 2.0 * i as f64)], PictureVerdict::Rest),
        false => record(i, vec![shifted(30, 0.0)], PictureVerdict::Rest),
    };
    let original: Vec<FrameRecord> = (0..60).map(view).collect();
    let frames = converted(original.clone());
    for (i, (frame, before)) in frames.iter().zip(&original).enumerate() {
        let watch = frame.watch.as_ref().unwrap();
        let shift_px = if i < 30 { 2.0 * i as f64 } else { 0.0 };
        assert_eq!((watch.place, watch.moved.is_some()), (Some(usize::from(i >= 30)), i == 30), "frame {i}");
        let moved_px = before.cars[0].bbox_px[0] - frame.cars[0].bbox_px[0];
        assert!((moved_px - shift_px).abs() < 1e-9, "frame {i}: {moved_px}");
    }
}

#[test]
fn a_broken_link_does_not_divide_a_place() {
    // The two measurements of the link from 0 to 5 are opposite turns, so their mean has no inverse.
    let upside_down =
        Registration { homography: Some([-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), ..shifted(5, 0.0) };
    let weak = |reference: u64| Registration { sd_px: 2.0, ..shifted(reference, 0.0) };
    let motions = [
        vec![shifted(0, 0.0), shifted(5, 0.0)],
        vec![shifted(0, 0.0), upside_down],
        vec![weak(0), weak(9)],
        vec![weak(5), weak(9)],
    ];
    let view = |(i, motion): (usize, Vec<Registration>)| record(10 * i as u64, motion, PictureVerdict::Rest);
    let frames: Vec<FrameRecord> = motions.into_iter().enumerate().map(view).collect();
    let places = places(&frames);
    for reference in [0, 5, 9] {
        let at = places.position(&shifted(reference, 0.0), frames[0].image_size_px);
        assert_eq!(at.map(|(place, _)| place), Some(0), "reference {reference}");
    }
}
