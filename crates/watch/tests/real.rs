//! Tests the watcher on real surveillance video. The cameras are at rest, so no move may be reported.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::{Path, PathBuf};

use roadplane_base::PictureVerdict;
use roadplane_decode::{DecodeOptions, open};
use roadplane_watch::Watcher;

const STRIDES: std::ops::RangeInclusive<u64> = 1..=12;

/// Returns the videos in a folder of `shared/data`, which lies beside the repository.
fn clips(folder: &str) -> Vec<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(folder);
    let mut clips: Vec<PathBuf> = path.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
    clips.retain(|path| path.extension().is_some_and(|e| e == "mp4"));
    clips.sort();
    clips
}

/// Runs the watcher on a clip at all strides. No move may be reported, and every verdict before `until_s` must be the
/// expected one.
fn stays(clip: &Path, expected: PictureVerdict, until_s: f64) {
    let mut input = open(clip, &DecodeOptions::default()).unwrap();
    let mut watchers: Vec<_> = STRIDES.map(|stride| (stride, Watcher::new(), Vec::new())).collect();
    let mut frame_number = 0;
    while let Some(frame) = input.next_frame().unwrap() {
        for (stride, watcher, verdicts) in &mut watchers {
            if frame_number % *stride == 0 {
                let record = watcher.observe(frame.stamp, &frame.image).unwrap().record;
                let here = format!("{}, stride {stride}, {:.2} s", clip.display(), frame.stamp.time_s());
                assert_eq!(record.moved, None, "{here}");
                if frame.stamp.time_s() < until_s {
                    verdicts.push((here, record.verdict));
                }
            }
        }
        frame_number += 1;
    }
    for (_, _, verdicts) in &watchers {
        let other = verdicts.iter().find(|(_, verdict)| *verdict != expected);
        assert_eq!(other, None, "of {} pictures", verdicts.len());
    }
}

fn rests(clip: &Path) {
    stays(clip, PictureVerdict::Rest, f64::INFINITY);
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn road_cameras_rest() {
    for clip in clips("clips") {
        match clip.file_stem().and_then(|name| name.to_str()) {
            // The last 0.6 s of this clip come from another camera.
            Some("street_queue") => stays(&clip, PictureVerdict::Rest, 28.0),
            // This clip shows bare asphalt, on which a shift is invisible.
            Some("barrier") => stays(&clip, PictureVerdict::Unknown, f64::INFINITY),
            _ => rests(&clip),
        }
    }
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn car_park_cameras_rest() {
    clips("virat").iter().for_each(|clip| rests(clip));
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn gantry_cameras_rest() {
    clips("cameras").iter().for_each(|clip| rests(clip));
}
