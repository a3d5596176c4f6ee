//! Tests that reading a long clip in parts gives the same frames as reading it in one run.

#![allow(clippy::unwrap_used)] // the helpers below are test code, too

use std::path::Path;

use opencv::core::{Mat, Scalar, Size};
use opencv::prelude::*;
use opencv::videoio::{CAP_FFMPEG, VideoWriter};
use roadplane_decode::{DecodeOptions, DecodeReport, Input, open, open_part};

const FPS: f64 = 25.0;
const FRAMES: u64 = 500;

/// Writes a clip in which the grey value of each picture is its number. A bar moves across the pictures.
fn write_clip(path: &Path, codec: &[u8; 4]) {
    let fourcc = i32::from_le_bytes(*codec);
    let size = Size::new(160, 96);
    let mut writer =
        VideoWriter::new_with_backend(path.to_str().unwrap(), CAP_FFMPEG, fourcc, FPS, size, true).unwrap();
    for i in 0..FRAMES {
        let grey = Scalar::all((i % 200) as f64);
        let mut picture = Mat::new_size_with_default(size, opencv::core::CV_8UC3, grey).unwrap();
        let from = (i as usize * 37) % 40_000;
        picture.data_bytes_mut().unwrap()[from..from + 3000].fill(230);
        writer.write(&picture).unwrap();
    }
    writer.release().unwrap();
}

/// Returns the index, the time and the pixels of all frames from the time `from_s` on.
fn frames(mut input: Input, from_s: f64) -> (Vec<(u64, f64, Vec<u8>)>, DecodeReport) {
    let mut frames = Vec::new();
    while let Some(frame) = input.next_frame().unwrap() {
        if frame.stamp.time_s() >= from_s {
            frames.push((frame.stamp.index, frame.stamp.time_s(), frame.image.into_raw()));
        }
    }
    (frames, input.report().clone())
}

/// Compares the whole clip with three parts. Decoding of each part starts a second before the part.
fn compare(path: &Path, what: &str) {
    let (whole, report) = frames(open(path, &DecodeOptions::default()).unwrap(), 0.0);
    let (mut joined, mut counts) = (Vec::new(), [0; 4]);
    let of = |report: &DecodeReport| {
        [report.expected, report.decoded, report.missing, u64::from(report.cut_short) + report.broken_packets]
    };
    for (from_s, to_s) in [(0.0, Some(6.4)), (6.4, Some(13.0)), (13.0, None)] {
        let options =
            DecodeOptions { start_s: f64::max(0.0, from_s - 1.0), end_s: to_s, ..DecodeOptions::default() };
        let (part, report) = frames(open_part(path, &options, from_s).unwrap(), from_s);
        assert!(!part.is_empty(), "{what} from {from_s} s");
        joined.extend(part);
        counts.iter_mut().zip(of(&report)).for_each(|(sum, count)| *sum += count);
    }
    let stamps = |frames: &[(u64, f64, Vec<u8>)]| frames.iter().map(|(i, t, _)| (*i, *t)).collect::<Vec<_>>();
    let (joined_stamps, whole_stamps) = (stamps(&joined), stamps(&whole));
    let differ = joined_stamps.iter().zip(&whole_stamps).find(|(a, b)| a != b);
    assert_eq!((differ, joined.len()), (None, whole.len()), "{what}");
    assert!(joined == whole, "{what}: pixels");
    assert_eq!(counts, of(&report), "{what}");
}

#[test]
fn parts_together_are_the_whole_and_losses_are_counted_once() {
    let folder = tempfile::tempdir().unwrap();
    for (container, codec) in [("mp4", b"mp4v"), ("mkv", b"mp4v"), ("avi", b"MJPG"), ("ts", b"mpg2")] {
        let path = folder.path().join(format!("clip.{container}"));
        write_clip(&path, codec);
        compare(&path, container);
        // An AVI has no times. If it is read from its start, frames after damage get times that are too early.
        if container == "mp4" {
            let mut bytes = std::fs::read(&path).unwrap();
            for percent in [28, 45, 71] {
                let (from, length) = (bytes.len() * percent / 100, bytes.len() / 200);
                bytes[from..from + length].fill(0);
            }
            let damaged = folder.path().join("damaged.mp4");
            std::fs::write(&damaged, bytes).unwrap();
            compare(&damaged, "damaged mp4");
        }
    }
}
