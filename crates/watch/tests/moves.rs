//! Tests on clips with known camera motion that the watcher reports the right moves at the right times.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod made;

use std::collections::BTreeSet;

use made::{Grey, Made, Played, Scene, View, WatchedClip, shift_of, watched};
use nalgebra::Vector2;
use roadplane_base::{FrameStamp, MoveKind, PictureVerdict, WatchRecord};
use roadplane_watch::{RENEW_S, Watcher};

const STRIDES: [u64; 2] = [1, 3];
const ALL: [u64; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

/// Runs the watcher on a clip of a scene. `view` returns the camera's view at a time, s.
fn turned(scene: &dyn Scene, seconds: f64, strides: &[u64], view: impl Fn(f64) -> View) -> Vec<WatchedClip> {
    watched(scene.fps(), seconds, strides, |frame, time_s| {
        scene.at(frame).seen(scene.picture(), view(time_s)).noisy(frame)
    })
}

/// Runs the watcher on a clip of a camera at rest. `alter` changes each picture before noise is added.
fn altered(
    scene: &dyn Scene,
    seconds: f64,
    strides: &[u64],
    alter: impl Fn(Grey, u64, f64) -> Grey,
) -> Vec<WatchedClip> {
    watched(scene.fps(), seconds, strides, |frame, time_s| {
        alter(scene.at(frame).seen(scene.picture(), View::default()), frame, time_s).noisy(frame)
    })
}

fn lot() -> Played {
    Played::new("lot.mp4")
}

fn scene() -> Played {
    Played::new("lots/scenes/clip_0003.mp4")
}

fn no_move(clips: &[WatchedClip], what: &str) {
    for clip in clips {
        assert!(clip.moves().is_empty(), "{what}, stride {}: {:?}", clip.stride, clip.moves());
    }
}

/// Checks that the clip has exactly one move, of this kind and at this time.
fn one_move(clip: &WatchedClip, kind: MoveKind, since_s: f64, what: &str) -> roadplane_base::CameraMove {
    let moves = clip.moves();
    let [moved] = moves[..] else { panic!("{what}, stride {}: {moves:?}", clip.stride) };
    println!("{what}, stride {}: {moved:?}, truth {since_s} s", clip.stride);
    assert_eq!(moved.kind, kind, "{what}, stride {}: {moved:?}", clip.stride);
    assert!((moved.since_s - since_s).abs() <= 0.5, "{what}, stride {}: {moved:?}", clip.stride);
    assert!((moved.since_frame as f64 - since_s * clip.fps).abs() <= 0.5 * clip.fps, "{moved:?}");
    moved
}

#[test]
fn a_camera_at_rest_is_at_rest_at_every_stride() {
    for scene in [&Made::new(1) as &dyn Scene, &lot(), &scene()] {
        let clips = turned(scene, 8.0, &ALL, |_| View::default());
        no_move(&clips, "at rest");
        for clip in &clips {
            let rests = clip.between(0.0, 8.0).iter().all(|v| *v == PictureVerdict::Rest);
            assert!(rests, "stride {}: {:?}", clip.stride, clip.between(0.0, 8.0));
        }
    }
}

#[test]
fn a_turn_is_reported_once_with_its_size_and_frame() {
    for (name, scene) in [("made", &Made::new(2) as &dyn Scene), ("lot", &lot()), ("scene", &scene())] {
        for (x, y) in [(3.0, 0.0), (-8.0, 6.0), (60.0, 0.0)] {
            let what = format!("{name} turned by {x}, {y}");
            let view = |t: f64| if t < 3.0 { View::default() } else { View::shifted(x, y) };
            for clip in turned(scene, 6.5, &STRIDES, view) {
                let moved = one_move(&clip, MoveKind::Turned, 3.0, &what);
                let [u, v] = moved.shift_px.unwrap();
                assert!((u - x).hypot(v - y) <= 1.0, "{what}, stride {}: {moved:?}", clip.stride);
                let rests = clip.between(5.5, 6.5).iter().all(|v| *v == PictureVerdict::Rest);
                assert!(rests, "{what}, stride {}: it does not rest", clip.stride);
            }
        }
    }
}

#[test]
fn a_pan_is_reported_when_it_begins_and_when_it_ends() {
    for (name, scene) in [("made", &Made::new(3) as &dyn Scene), ("scene", &scene())] {
        let view = |t: f64| View::shifted(15.0 * (t.clamp(2.0, 7.0) - 4.5), 0.0);
        for clip in turned(scene, 10.0, &STRIDES, view) {
            let moves = clip.moves();
            println!("{name}, stride {}: {moves:?}", clip.stride);
            let [begun, ended] = moves[..] else { panic!("{name}, stride {}: {moves:?}", clip.stride) };
            assert_eq!((begun.kind, ended.kind), (MoveKind::Moving, MoveKind::Turned));
            // A candidate position is abandoned only after two displaced pictures.
            let near = 0.5_f64.max(2.0 * clip.stride as f64 / clip.fps);
            assert!((begun.since_s - 2.0).abs() <= near, "stride {}: {begun:?}", clip.stride);
            assert!((ended.since_s - 7.0).abs() <= near, "stride {}: {ended:?}", clip.stride);
        }
    }
}

#[test]
fn a_zoom_is_reported_with_its_growth() {
    for (name, scene) in [("made", &Made::new(4) as &dyn Scene), ("scene", &scene())] {
        for growth in [1.05_f64, 0.95] {
            let view =
                |t: f64| View { log_scale: if t < 3.0 { 0.0 } else { growth.ln() }, ..View::default() };
            let what = format!("{name} zoomed to {growth}");
            for clip in turned(scene, 6.5, &STRIDES, view) {
                let moved = one_move(&clip, MoveKind::Zoomed, 3.0, &what);
                assert!((moved.log_scale.unwrap() - growth.ln()).abs() <= 0.005, "{what}: {moved:?}");
            }
        }
    }
}

#[test]
fn a_shaken_camera_has_not_moved_and_its_shake_is_followed() {
    for (name, scene) in [("made", &Made::new(5) as &dyn Scene), ("scene", &scene())] {
        for hertz in [3.1_f64, 0.4] {
            let at = |t: f64| {
                let swing = 2.0 * (std::f64::consts::TAU * hertz * t).sin();
                [0.8 * swing, 0.6 * swing]
            };
            let clips = turned(scene, 10.0, &STRIDES, |t| View { shift: at(t), log_scale: 0.0 });
            no_move(&clips, &format!("{name} shaken at {hertz}/s"));
            for clip in clips {
                let late: Vec<_> = clip.frames.iter().filter(|(stamp, ..)| stamp.time_s() > 3.0).collect();
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
                    clip.stride
                );
                // Shifts and offsets below the noise are reported as zero.
                assert!(shift <= 0.8, "{name}, {hertz}/s, stride {}: {shift}", clip.stride);
                assert!(offset <= 0.8, "{name}, {hertz}/s, stride {}: {offset}", clip.stride);
            }
        }
    }
}

#[test]
fn the_motion_is_measured_through_a_pan_and_a_zoom_and_back() {
    for (name, scene) in [("made", &Made::new(12) as &dyn Scene), ("scene", &scene())] {
        let view = |t: f64| {
            let share = (std::f64::consts::PI * t / 6.0).sin();
            View { shift: [120.0 * share, -30.0 * share], log_scale: 0.1 * share }
        };
        for clip in turned(scene, 6.0, &STRIDES, view) {
            let (width, height) = scene.picture();
            let truth = |frame: u64, p: Vector2<f64>| {
                let View { shift, log_scale } = view(frame as f64 / clip.fps);
                Vector2::from(shift) + p * log_scale.exp()
            };
            let middle = Vector2::new(width as f64 - 1.0, height as f64 - 1.0) / 2.0;
            let mut errors_px: Vec<f64> = Vec::new();
            for (stamp, record, _) in &clip.frames {
                let registration = record.motion.first();
                let registration =
                    registration.unwrap_or_else(|| panic!("{name}: frame {} is lost", stamp.index));
                let mapping = registration.homography_for(0.0);
                for (u, v) in [(0.0, 0.0), (-0.25, 0.2), (0.25, -0.2)] {
                    let scene_point = Vector2::new(u * width as f64, v * height as f64);
                    let from = truth(registration.reference, scene_point) + middle;
                    let to = truth(stamp.index, scene_point) + middle;
                    errors_px.push((mapping.apply(&from) - to).norm());
                }
            }
            errors_px.sort_by(f64::total_cmp);
            let share = |share: f64| errors_px[((errors_px.len() - 1) as f64 * share) as usize];
            let [most, worst] = [share(0.9), share(1.0)];
            println!("{name}, stride {}: motion off by {most:.2}, at most {worst:.2} px", clip.stride);
            assert!(most < 0.8 && worst < 3.0, "{name}, stride {}: {most}, {worst}", clip.stride);
            let references: BTreeSet<u64> =
                clip.frames.iter().map(|(_, r, _)| r.motion[0].reference).collect();
            assert!(references.len() <= 4, "{name}: {references:?}");
        }
    }
}

#[test]
fn another_scene_is_a_cut_and_so_is_the_return() {
    let (here, there) = (Made::new(6), Made::new(7));
    let cuts = |fps: f64, here: &dyn Scene, there: &dyn Scene| {
        watched(fps, 9.0, &STRIDES, |frame, time_s| {
            let scene = if (3.0..6.0).contains(&time_s) { there } else { here };
            scene.at(frame).seen(scene.picture(), View::default()).noisy(frame)
        })
    };
    let mut clips = cuts(30.0, &here, &there);
    clips.extend(cuts(10.0, &scene(), &lot()));
    for clip in clips {
        let moves = clip.moves();
        println!("stride {}: {moves:?}", clip.stride);
        let [away, back] = moves[..] else { panic!("stride {}: {moves:?}", clip.stride) };
        assert_eq!((away.kind, back.kind), (MoveKind::Cut, MoveKind::Cut), "stride {}", clip.stride);
        assert!((away.since_s - 3.0).abs() <= 0.5, "stride {}: {away:?}", clip.stride);
        assert!((back.since_s - 6.0).abs() <= 0.5, "stride {}: {back:?}", clip.stride);
    }
}

#[test]
fn lights_that_go_on_and_off_are_no_move() {
    for (name, scene) in [("made", &Made::new(8) as &dyn Scene), ("scene", &scene())] {
        let dark = |t: f64| if (3.0..6.0).contains(&t) { 1.0 } else { 0.18 };
        no_move(&altered(scene, 9.0, &STRIDES, |p, _, t| p.lit(dark(t))), name);
    }
}

#[test]
fn a_bus_in_front_of_half_the_picture_is_no_move() {
    // In the car park, only one half of the picture has structure. The bus drives across this half.
    for (name, scene) in [("made", &Made::new(9) as &dyn Scene), ("scene", &scene()), ("lot", &lot())] {
        let (width, height) = scene.picture();
        let bus = Grey::textured(width / 2, height, 90);
        let clips = altered(scene, 12.0, &STRIDES, |mut picture, _, t| {
            let (out, half) = (width as f64 / 2.0, width as f64 / 4.0);
            let x = match t {
                t if t < 3.0 => -out,
                t if t < 4.5 => -out + (out + half) * (t - 3.0) / 1.5,
                t if t < 9.5 => half,
                t => half + (width as f64 - half) * (t - 9.5) / 1.5,
            };
            picture.paste(&bus, x.round() as i64, 0);
            picture
        });
        no_move(&clips, &format!("{name} with a bus"));
    }
}

#[test]
fn empty_pictures_get_their_verdict_and_the_background_survives_them() {
    use PictureVerdict::{Black, Covered, White};
    for (name, scene) in [("made", &Made::new(10) as &dyn Scene), ("scene", &scene())] {
        for (verdict, grey) in [(Black, 6), (White, 248), (Covered, 118)] {
            let nothing = |t: f64| (2.0..4.0).contains(&t);
            let clips = altered(scene, 6.0, &STRIDES, |p, _, t| if nothing(t) { p.uniform(grey) } else { p });
            no_move(&clips, &format!("{name} {verdict:?}"));
            for clip in clips {
                let first = clip.first(verdict).unwrap();
                assert!((2.0..=2.5).contains(&first), "{name} {verdict:?}, stride {}: {first}", clip.stride);
                assert!(clip.between(2.5, 4.0).iter().all(|v| *v == verdict), "{name} {verdict:?}");
                let after = clip.between(4.5, 6.0);
                assert!(after.iter().all(|v| *v == PictureVerdict::Rest), "{name} {verdict:?}: {after:?}");
            }
        }
    }
}

#[test]
fn a_picture_that_stays_the_same_is_frozen() {
    let scene = Made::new(11);
    let clips = watched(scene.fps(), 8.0, &STRIDES, |frame, time_s| {
        let frame = if (3.0..6.0).contains(&time_s) { 90 } else { frame };
        scene.at(frame).seen(scene.picture(), View::default()).noisy(frame)
    });
    no_move(&clips, "frozen");
    for clip in clips {
        let first = clip.first(PictureVerdict::Frozen).unwrap();
        println!("stride {}: frozen at {first} s, truth 3 s", clip.stride);
        assert!((3.0..=4.5).contains(&first), "stride {}: {first}", clip.stride);
        assert!(clip.between(6.5, 8.0).iter().all(|v| *v == PictureVerdict::Rest), "stride {}", clip.stride);
    }
}

#[test]
fn dense_traffic_is_no_camera_motion() {
    // Five lanes full of vehicles, each lane 48 px high, in a picture 360 px high.
    let lanes: Vec<(f64, i64, u32)> =
        (0..5).map(|i| ([-5.0, 3.0, -2.0, 6.0, 4.0][i], 130 + 48 * i as i64, 8)).collect();
    let clips = turned(&Made::with_traffic(12, &lanes), 8.0, &STRIDES, |_| View::default());
    for clip in clips {
        let verdicts = clip.between(0.0, 8.0);
        assert!(verdicts.iter().all(|v| *v == PictureVerdict::Rest), "stride {}: {verdicts:?}", clip.stride);
    }
}

#[test]
fn pictures_before_the_last_minute_have_no_effect() {
    let scene = Made::new(11);
    // The camera is shaken all the time. In the first minute it is also turned slightly.
    let view = |t: f64| {
        let swing = 1.5 * (std::f64::consts::TAU * 0.7 * t).sin();
        View::shifted(if t < 30.0 { 4.0 } else { 0.0 } + swing, 0.5 * swing)
    };
    let from = |from_s: f64| {
        let mut watcher = Watcher::new();
        let mut records = Vec::new();
        for frame in (0..(125.0 * scene.fps()) as u64).step_by(6) {
            let time_s = frame as f64 / scene.fps();
            if time_s < from_s {
                continue;
            }
            let stamp = FrameStamp { index: frame, pts_nanos: (time_s * 1e9).round() as i64 };
            let picture = scene.at(frame).seen(scene.picture(), view(time_s)).noisy(frame);
            let picture = picture.rgb();
            let seen = watcher.observe(stamp, &picture).unwrap();
            records.push((time_s, seen.record, shift_of(seen.view.as_ref(), &picture)));
        }
        records
    };
    let whole = from(0.0);
    assert!(whole.iter().any(|(_, record, _)| record.moved.is_some()), "the turn is reported");
    for minute_s in [60.0, 120.0] {
        let piece = from(minute_s - RENEW_S - 1.0);
        let after = |records: &[(f64, WatchRecord, [f64; 2])]| {
            records.iter().filter(|(time_s, ..)| *time_s >= minute_s).cloned().collect::<Vec<_>>()
        };
        assert!(after(&piece).len() > 20);
        assert_eq!(after(&piece), after(&whole), "from {minute_s} s on");
    }
}
