//! Tests files with impossible numbers in their headers. The result must be an error message, or frames with valid
//! times.

#![allow(clippy::unwrap_used, clippy::panic)] // the helpers below are test code, too

use std::path::Path;
use std::time::{Duration, Instant};

use opencv::core::{Mat, Scalar, Size};
use opencv::prelude::*;
use opencv::videoio::{CAP_FFMPEG, VideoWriter};
use roadplane_decode::{DecodeOptions, open};

const FRAMES: u64 = 40;
const PATIENCE: Duration = Duration::from_secs(20);

fn write_clip(path: &Path, codec: &[u8; 4]) {
    let (fourcc, size) = (i32::from_le_bytes(*codec), Size::new(160, 96));
    let name = path.to_str().unwrap();
    let mut writer = VideoWriter::new_with_backend(name, CAP_FFMPEG, fourcc, 25.0, size, true).unwrap();
    for i in 0..FRAMES {
        let grey = Scalar::all(5.0 * i as f64);
        writer.write(&Mat::new_size_with_default(size, opencv::core::CV_8UC3, grey).unwrap()).unwrap();
    }
    writer.release().unwrap();
}

/// Returns the positions of 32-bit header fields in a file. The fields belong to the box or chunk with this name, and
/// `offsets` count from the end of the name.
fn fields(bytes: &[u8], name: &[u8; 4], offsets: &[usize]) -> Vec<usize> {
    let at = bytes.windows(4).position(|window| window == name);
    let at = at.unwrap_or_else(|| panic!("no {}", String::from_utf8_lossy(name)));
    offsets.iter().map(|offset| at + 4 + offset).collect()
}

#[test]
fn impossible_numbers_in_headers_give_an_error_or_sound_frames() {
    let folder = tempfile::tempdir().unwrap();
    // These fields are scales, durations, counts, steps and sizes in pixels. See ISO/IEC 14496-12 and the RIFF AVI
    // headers.
    type Fields = &'static [(&'static [u8; 4], &'static [usize])];
    let mp4: Fields = &[
        (b"mvhd", &[12, 16]),
        (b"tkhd", &[20, 76, 80]),
        (b"mdhd", &[12, 16]),
        (b"stts", &[4, 8, 12]),
        (b"stsz", &[4, 8, 12]),
        (b"stsc", &[4, 8, 12]),
        (b"stco", &[4, 8]),
        (b"mp4v", &[24]),
    ];
    let avi: Fields =
        &[(b"avih", &[4, 8, 20, 24, 28, 36, 40]), (b"strh", &[24, 28, 32, 36, 40]), (b"strf", &[8, 12])];
    let (mut read, mut refused) = (0, 0);
    for (name, codec, headers, big_endian) in [("a.mp4", b"mp4v", mp4, true), ("a.avi", b"MJPG", avi, false)]
    {
        let path = folder.path().join(name);
        write_clip(&path, codec);
        let sound = std::fs::read(&path).unwrap();
        let positions = headers.iter().flat_map(|(name, offsets)| fields(&sound, name, offsets));
        for position in positions.collect::<Vec<_>>() {
            for value in [0_u32, 1, 0xffff, 0x7fff_ffff, 0x8000_0000, u32::MAX] {
                let what = format!("{name}, byte {position} = {value:#x}");
                let mut bytes = sound.clone();
                let field = if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
                bytes[position..position + 4].copy_from_slice(&field);
                std::fs::write(&path, bytes).unwrap();
                let begun = Instant::now();
                let (mut count, mut last_s) = (0, f64::NEG_INFINITY);
                match open(&path, &DecodeOptions::default()) {
                    Ok(mut input) => {
                        assert!(input.nominal_fps().is_finite() && input.nominal_fps() > 0.0, "{what}");
                        while let Ok(Some(frame)) = input.next_frame() {
                            let time_s = frame.stamp.time_s();
                            assert!(
                                time_s.is_finite() && time_s > last_s,
                                "{what}: {time_s} s after {last_s} s"
                            );
                            (last_s, count) = (time_s, count + 1);
                        }
                        assert!((1..=FRAMES).contains(&count), "{what}: {count} frames");
                        read += 1;
                    }
                    Err(error) => {
                        assert!(error.to_string().len() > 10, "{what}");
                        refused += 1;
                    }
                }
                assert!(begun.elapsed() < PATIENCE, "{what}: {:?}", begun.elapsed());
            }
        }
    }
    println!("{read} read, {refused} refused");
    assert!(read > 0 && refused > 0);
}
