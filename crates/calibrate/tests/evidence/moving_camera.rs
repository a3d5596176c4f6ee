use roadplane_base::{CameraMove, FrameRecord, MoveKind, PictureVerdict, WatchRecord};
use roadplane_calibrate::{EvidenceBuilder, Window};
use roadplane_synth::Rng;

use crate::records::{frame, rows};

/// Cuts 100 frames at 25 frames/s into windows of 1 s. From each frame in `moves` on, the camera is at that place.
fn windows(moves: &[(u64, usize)]) -> Vec<Window> {
    let mut random = Rng::new(1);
    let cars = rows(5);
    let mut builder = EvidenceBuilder::new(1.0);
    let record = |i: u64| {
        let moved = moves.iter().find(|(at, _)| *at == i).map(|(_, place)| WatchRecord {
            looked: true,
            verdict: PictureVerdict::Rest,
            moved: Some(CameraMove {
                kind: MoveKind::Cut,
                since_frame: i,
                since_s: i as f64 / 25.0,
                shift_px: None,
                log_scale: None,
            }),
            place: Some(*place),
            ..WatchRecord::default()
        });
        FrameRecord { watch: moved, ..frame(i, i as f64 / 25.0, &cars, 2.0, 1.0, &mut random) }
    };
    let mut found: Vec<Window> = (0..100).map(record).filter_map(|frame| builder.push(&frame)).collect();
    found.extend(builder.finish());
    found
}

#[test]
fn windows_end_where_the_camera_moves_and_no_frame_is_lost() {
    let windows = windows(&[(40, 1), (80, 0)]);
    assert_eq!(
        windows.iter().map(|w| (w.segment, w.frames)).collect::<Vec<_>>(),
        [(0, 25), (0, 15), (1, 25), (1, 15), (0, 20)]
    );
    assert!(windows.iter().all(|w| !w.views.is_empty() && !w.on_second_plane));
    let links = |segment: usize| {
        let of_segment = windows.iter().filter(move |w| w.segment == segment);
        of_segment
            .flat_map(|w| w.views.iter().map(|view| view.link))
            .collect::<std::collections::BTreeSet<_>>()
    };
    assert!(links(0).is_disjoint(&links(1)), "cars of another position are other cars");
}

#[test]
fn a_camera_at_rest_has_one_position() {
    let windows = windows(&[]);
    assert_eq!(windows.iter().map(|w| (w.segment, w.frames)).collect::<Vec<_>>(), [(0, 25); 4]);
}
