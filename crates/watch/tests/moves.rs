//! What the watcher tells of clips whose camera is known to move, and when.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod made;

use made::{Grey, Made, Place, Played, Told, View, watched};
use roadplane_base::{FrameStamp, MoveKind, PictureVerdict, WatchRecord};
use roadplane_watch::{RENEW_S, Watcher};

const STRIDES: [u64; 2] = [1, 3];
const ALL: [u64; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

/// A clip of a camera that looks at a place like this.
fn turned(place: &dyn Place, seconds: f64, strides: &[u64], view: impl Fn(f64) -> View) -> Vec<Told> {
    watched(place.fps(), seconds, strides, |frame, time_s| {
        place.at(frame).seen(place.picture(), view(time_s)).noisy(frame)
    })
}

/// A clip of a camera at rest, whose pictures are changed before noise comes in.
fn altered(
    place: &dyn Place,
    seconds: f64,
    strides: &[u64],
    alter: impl Fn(Grey, u64, f64) -> Grey,
) -> Vec<Told> {
    watched(place.fps(), seconds, strides, |frame, time_s| {
        alter(place.at(frame).seen(place.picture(), View::default()), frame, time_s).noisy(frame)
    })
}

fn lot() -> Played {
    Played::new("lot.mp4")
}

fn scene() -> Played {
    Played::new("lots/scenes/clip_0003.mp4")
}

fn no_move(told: &[Told], what: &str) {
    for told in told {
        assert!(told.moves().is_empty(), "{what}, stride {}: {:?}", told.stride, told.moves());
    }
}

/// One move of a kind, at that time.
fn one_move(told: &Told, kind: MoveKind, since_s: f64, what: &str) -> roadplane_base::CameraMove {
    let moves = told.moves();
    let [moved] = moves[..] else { panic!("{what}, stride {}: {moves:?}", told.stride) };
    println!("{what}, stride {}: {moved:?}, truth {since_s} s", told.stride);
    assert_eq!(moved.kind, kind, "{what}, stride {}: {moved:?}", told.stride);
    assert!((moved.since_s - since_s).abs() <= 0.5, "{what}, stride {}: {moved:?}", told.stride);
    assert!((moved.since_frame as f64 - since_s * told.fps).abs() <= 0.5 * told.fps, "{moved:?}");
    moved
}

#[test]
fn a_camera_at_rest_stays_there_at_every_stride() {
    for place in [&Made::new(1) as &dyn Place, &lot(), &scene()] {
        let told = turned(place, 8.0, &ALL, |_| View::default());
        no_move(&told, "at rest");
        for told in &told {
            let rests = told.between(0.0, 8.0).iter().all(|v| *v == PictureVerdict::Rest);
            assert!(rests, "stride {}: {:?}", told.stride, told.between(0.0, 8.0));
        }
    }
}

#[test]
fn a_turn_is_told_once_with_its_size_and_its_frame() {
    for (name, place) in [("made", &Made::new(2) as &dyn Place), ("lot", &lot()), ("scene", &scene())] {
        for (x, y) in [(3.0, 0.0), (-8.0, 6.0), (60.0, 0.0)] {
            let what = format!("{name} turned by {x}, {y}");
            let view = |t: f64| if t < 3.0 { View::default() } else { View::shifted(x, y) };
            for told in turned(place, 6.5, &STRIDES, view) {
                let moved = one_move(&told, MoveKind::Turned, 3.0, &what);
                let [u, v] = moved.shift_px.unwrap();
                assert!((u - x).hypot(v - y) <= 1.0, "{what}, stride {}: {moved:?}", told.stride);
                let rests = told.between(5.5, 6.5).iter().all(|v| *v == PictureVerdict::Rest);
                assert!(rests, "{what}, stride {}: it does not rest", told.stride);
            }
        }
    }
}

#[test]
fn a_pan_is_told_when_it_begins_and_when_it_ends() {
    for (name, place) in [("made", &Made::new(3) as &dyn Place), ("scene", &scene())] {
        let view = |t: f64| View::shifted(15.0 * (t.clamp(2.0, 7.0) - 4.5), 0.0);
        for told in turned(place, 10.0, &STRIDES, view) {
            let moves = told.moves();
            println!("{name}, stride {}: {moves:?}", told.stride);
            let [begun, ended] = moves[..] else { panic!("{name}, stride {}: {moves:?}", told.stride) };
            assert_eq!((begun.kind, ended.kind), (MoveKind::Moving, MoveKind::Turned));
            // Two pictures must lie elsewhere before a position is given up.
            let near = 0.5_f64.max(2.0 * told.stride as f64 / told.fps);
            assert!((begun.since_s - 2.0).abs() <= near, "stride {}: {begun:?}", told.stride);
            assert!((ended.since_s - 7.0).abs() <= near, "stride {}: {ended:?}", told.stride);
        }
    }
}

#[test]
fn a_zoom_is_told_with_its_growth() {
    for (name, place) in [("made", &Made::new(4) as &dyn Place), ("scene", &scene())] {
        for growth in [1.05_f64, 0.95] {
            let view =
                |t: f64| View { log_scale: if t < 3.0 { 0.0 } else { growth.ln() }, ..View::default() };
            let what = format!("{name} zoomed to {growth}");
            for told in turned(place, 6.5, &STRIDES, view) {
                let moved = one_move(&told, MoveKind::Zoomed, 3.0, &what);
                assert!((moved.log_scale.unwrap() - growth.ln()).abs() <= 0.005, "{what}: {moved:?}");
            }
        }
    }
}

#[test]
fn a_shaken_camera_has_not_moved_and_its_shake_is_followed() {
    for (name, place) in [("made", &Made::new(5) as &dyn Place), ("scene", &scene())] {
        for hertz in [3.1_f64, 0.4] {
            let at = |t: f64| {
                let swing = 2.0 * (std::f64::consts::TAU * hertz * t).sin();
                [0.8 * swing, 0.6 * swing]
            };
            let told = turned(place, 10.0, &STRIDES, |t| View { shift: at(t), log_scale: 0.0 });
            no_move(&told, &format!("{name} shaken at {hertz}/s"));
            for told in told {
                let late: Vec<_> = told.frames.iter().filter(|(stamp, ..)| stamp.time_s() > 3.0).collect();
                let off = |of: &dyn Fn(usize) -> [f64; 2]| -> Vec<[f64; 2]> {
                    let all: Vec<[f64; 2]> = (0..late.len())
                        .map(|i| {
                            let truth = at(late[i].0.time_s());
                            [of(i)[0] - truth[0], of(i)[1] - truth[1]]
                        })
                        .collect();
                    let mean = [0, 1].map(|axis| all.iter().map(|o| o[axis]).sum::<f64>() / all.len() as f64);
                    all.iter().map(|o| [o[0] - mean[0], o[1] - mean[1]]).collect()
                };
                let worst = |off: &[[f64; 2]]| off.iter().map(|o| o[0].hypot(o[1])).fold(0.0, f64::max);
                let shift = worst(&off(&|i| late[i].2));
                let offset = worst(&off(&|i| late[i].1.offset_px));
                println!(
                    "{name}, {hertz}/s, stride {}: shift off by {shift:.2}, offset {offset:.2} px",
                    told.stride
                );
                assert!(shift <= 0.5, "{name}, {hertz}/s, stride {}: {shift}", told.stride);
                // What is told leaves out the noise.
                assert!(offset <= 0.8, "{name}, {hertz}/s, stride {}: {offset}", told.stride);
            }
        }
    }
}

#[test]
fn another_scene_is_a_cut_and_so_is_the_way_back() {
    let (here, there) = (Made::new(6), Made::new(7));
    let cuts = |fps: f64, here: &dyn Place, there: &dyn Place| {
        watched(fps, 9.0, &STRIDES, |frame, time_s| {
            let place = if (3.0..6.0).contains(&time_s) { there } else { here };
            place.at(frame).seen(place.picture(), View::default()).noisy(frame)
        })
    };
    let mut told = cuts(30.0, &here, &there);
    told.extend(cuts(10.0, &scene(), &lot()));
    for told in told {
        let moves = told.moves();
        println!("stride {}: {moves:?}", told.stride);
        let [away, back] = moves[..] else { panic!("stride {}: {moves:?}", told.stride) };
        assert_eq!((away.kind, back.kind), (MoveKind::Cut, MoveKind::Cut), "stride {}", told.stride);
        assert!((away.since_s - 3.0).abs() <= 0.5, "stride {}: {away:?}", told.stride);
        assert!((back.since_s - 6.0).abs() <= 0.5, "stride {}: {back:?}", told.stride);
    }
}

#[test]
fn lights_that_go_on_and_off_are_no_move() {
    for (name, place) in [("made", &Made::new(8) as &dyn Place), ("scene", &scene())] {
        let dark = |t: f64| if (3.0..6.0).contains(&t) { 1.0 } else { 0.18 };
        no_move(&altered(place, 9.0, &STRIDES, |p, _, t| p.lit(dark(t))), name);
    }
}

#[test]
fn a_bus_before_half_the_picture_is_no_move() {
    // In the lot it drives across the half in which alone there is something to see.
    for (name, place) in [("made", &Made::new(9) as &dyn Place), ("scene", &scene()), ("lot", &lot())] {
        let (width, height) = place.picture();
        let bus = Grey::textured(width / 2, height, 90);
        let told = altered(place, 12.0, &STRIDES, |mut picture, _, t| {
            let (out, half) = (width as f64 / 2.0, width as f64 / 4.0);
            let x = match t {
                t if t < 3.0 => -out,
                t if t < 4.5 => -out + (out + half) * (t - 3.0) / 1.5,
                t if t < 9.5 => half,
                t => half + (width as f64 - half) * (t - 9.5) / 1.5,
            };
            picture.lay(&bus, x.round() as i64, 0);
            picture
        });
        no_move(&told, &format!("{name} with a bus"));
    }
}

#[test]
fn pictures_that_show_nothing_are_named_and_the_place_is_known_after() {
    use PictureVerdict::{Black, Covered, White};
    for (name, place) in [("made", &Made::new(10) as &dyn Place), ("scene", &scene())] {
        for (verdict, grey) in [(Black, 6), (White, 248), (Covered, 118)] {
            let nothing = |t: f64| (2.0..4.0).contains(&t);
            let told = altered(place, 6.0, &STRIDES, |p, _, t| if nothing(t) { p.uniform(grey) } else { p });
            no_move(&told, &format!("{name} {verdict:?}"));
            for told in told {
                let first = told.first(verdict).unwrap();
                assert!((2.0..=2.5).contains(&first), "{name} {verdict:?}, stride {}: {first}", told.stride);
                assert!(told.between(2.5, 4.0).iter().all(|v| *v == verdict), "{name} {verdict:?}");
                let after = told.between(4.5, 6.0);
                assert!(after.iter().all(|v| *v == PictureVerdict::Rest), "{name} {verdict:?}: {after:?}");
            }
        }
    }
}

#[test]
fn a_picture_that_stays_the_same_is_frozen() {
    let place = Made::new(11);
    let told = watched(place.fps(), 8.0, &STRIDES, |frame, time_s| {
        let frame = if (3.0..6.0).contains(&time_s) { 90 } else { frame };
        place.at(frame).seen(place.picture(), View::default()).noisy(frame)
    });
    no_move(&told, "frozen");
    for told in told {
        let first = told.first(PictureVerdict::Frozen).unwrap();
        println!("stride {}: frozen at {first} s, truth 3 s", told.stride);
        assert!((3.0..=4.5).contains(&first), "stride {}: {first}", told.stride);
        assert!(told.between(6.5, 8.0).iter().all(|v| *v == PictureVerdict::Rest), "stride {}", told.stride);
    }
}

#[test]
fn dense_traffic_is_rest() {
    // Five full lanes of 48 px in a picture of 360 px.
    let lanes: Vec<(f64, i64, u32)> =
        (0..5).map(|i| ([-5.0, 3.0, -2.0, 6.0, 4.0][i], 130 + 48 * i as i64, 8)).collect();
    let told = turned(&Made::with_traffic(12, &lanes), 8.0, &STRIDES, |_| View::default());
    for told in told {
        let verdicts = told.between(0.0, 8.0);
        assert!(verdicts.iter().all(|v| *v == PictureVerdict::Rest), "stride {}: {verdicts:?}", told.stride);
    }
}

#[test]
fn what_was_before_the_last_minute_does_not_matter() {
    let place = Made::new(11);
    // Shaken, and turned by a little in the first minute.
    let view = |t: f64| {
        let swing = 1.5 * (std::f64::consts::TAU * 0.7 * t).sin();
        View::shifted(if t < 30.0 { 4.0 } else { 0.0 } + swing, 0.5 * swing)
    };
    let from = |from_s: f64| {
        let mut watcher = Watcher::new();
        let mut told = Vec::new();
        for frame in (0..(125.0 * place.fps()) as u64).step_by(6) {
            let time_s = frame as f64 / place.fps();
            if time_s < from_s {
                continue;
            }
            let stamp = FrameStamp { index: frame, pts_nanos: (time_s * 1e9).round() as i64 };
            let picture = place.at(frame).seen(place.picture(), view(time_s)).noisy(frame);
            let seen = watcher.look(stamp, &picture.rgb()).unwrap();
            told.push((time_s, seen.record, [seen.shift.x, seen.shift.y]));
        }
        told
    };
    let whole = from(0.0);
    assert!(whole.iter().any(|(_, record, _)| record.moved.is_some()), "the turn is told");
    for minute_s in [60.0, 120.0] {
        let piece = from(minute_s - RENEW_S - 1.0);
        let after = |told: &[(f64, WatchRecord, [f64; 2])]| {
            told.iter().filter(|(time_s, ..)| *time_s >= minute_s).cloned().collect::<Vec<_>>()
        };
        assert!(after(&piece).len() > 20);
        assert_eq!(after(&piece), after(&whole), "from {minute_s} s on");
    }
}
