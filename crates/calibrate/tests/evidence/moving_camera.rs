use std::collections::BTreeSet;

use roadplane_base::{CameraMove, FrameRecord, MoveKind, WatchRecord};
use roadplane_calibrate::{EvidenceBuilder, Window};
use roadplane_synth::Rng;

use crate::records::{frame, rows};

/// Cuts 100 frames at 25 frames/s into windows of 1 s. From each frame in `moves` on, the camera is at that place.
fn windows(moves: &[(u64, Option<usize>)]) -> Vec<Window> {
    let mut random = Rng::new(1);
    let cars = rows(5);
    let mut builder = EvidenceBuilder::new(1.0);
    let record = |i: u64| {
        let (since_frame, since_s) = (i, i as f64 / 25.0);
        let to = moves.iter().find(|(at, _)| *at == i);
        let moved = CameraMove { kind: MoveKind::Cut, since_frame, since_s, shift_px: None, log_scale: None };
        let watch = WatchRecord {
            moved: to.map(|_| moved),
            place: to.and_then(|(_, place)| *place),
            ..WatchRecord::default()
        };
        FrameRecord { watch: Some(watch), ..frame(i, since_s, &cars, 2.0, 1.0, &mut random) }
    };
    let mut found: Vec<Window> = (0..100).map(record).filter_map(|frame| builder.push(&frame)).collect();
    found.extend(builder.finish());
    found
}

/// Returns the position and the number of frames of each window.
fn spans(windows: &[Window]) -> Vec<(usize, usize)> {
    windows.iter().map(|window| (window.position, window.frames)).collect()
}

#[test]
fn windows_end_where_the_camera_moves_and_no_frame_is_lost() {
    let windows = windows(&[(40, Some(1)), (80, Some(0))]);
    assert_eq!(spans(&windows), [(0, 25), (0, 15), (1, 25), (1, 15), (0, 20)]);
    assert!(windows.iter().all(|window| !window.views.is_empty()));
    let links = |position: usize| -> BTreeSet<u64> {
        let of_position = windows.iter().filter(|window| window.position == position);
        of_position.flat_map(|window| window.views.iter().map(|view| view.link)).collect()
    };
    assert!(links(0).is_disjoint(&links(1)), "cars of another position are other cars");
}

#[test]
fn without_a_place_each_move_leads_to_a_new_position() {
    assert_eq!(spans(&windows(&[(50, None), (75, None)])), [(0, 25), (0, 25), (1, 25), (2, 25)]);
}

#[test]
fn a_camera_at_rest_has_one_position() {
    assert_eq!(spans(&windows(&[])), [(0, 25); 4]);
}
