//! Tests small generated clips: whole, cut and damaged.

#![allow(clippy::unwrap_used, clippy::panic)] // the helpers below are test code, too

use std::path::{Path, PathBuf};

use opencv::core::{Mat, Scalar, Size};
use opencv::prelude::*;
use opencv::videoio::{CAP_FFMPEG, VideoWriter};
use roadplane_decode::{DecodeError, DecodeOptions, DecodeReport, FolderContent, Input, InputKind, open};

const FRAMES: u64 = 60;
const FPS: f64 = 25.0;

/// Containers and codecs of the generated clips.
const KINDS: [(&str, &[u8; 4]); 4] = [("mp4", b"mp4v"), ("mkv", b"mp4v"), ("avi", b"MJPG"), ("ts", b"mpg2")];

/// Writes a clip in which frame i has the grey value 4 i. A texture on it ensures that some packets are large.
fn write_clip(path: &Path, codec: &[u8; 4]) {
    let fourcc = i32::from_le_bytes(*codec);
    let size = Size::new(160, 96);
    let mut writer =
        VideoWriter::new_with_backend(path.to_str().unwrap(), CAP_FFMPEG, fourcc, FPS, size, true).unwrap();
    assert!(writer.is_opened().unwrap(), "{} cannot be written", path.display());
    for i in 0..FRAMES {
        let grey = Scalar::all(4.0 * i as f64);
        let mut picture = Mat::new_size_with_default(size, opencv::core::CV_8UC3, grey).unwrap();
        for (at, byte) in picture.data_bytes_mut().unwrap().iter_mut().enumerate() {
            *byte = byte.saturating_add((at as u64 * 2_654_435_761 % (40 + i)) as u8 / 4);
        }
        writer.write(&picture).unwrap();
    }
    writer.release().unwrap();
}

fn read_all(input: &mut Input) -> (Vec<u64>, Vec<f64>, DecodeReport) {
    let (mut indices, mut times) = (Vec::new(), Vec::new());
    while let Some(frame) = input.next_frame().unwrap() {
        assert_eq!(frame.size(), input.size());
        indices.push(frame.stamp.index);
        times.push(frame.stamp.time_s());
    }
    assert!(input.next_frame().unwrap().is_none(), "the end stays the end");
    (indices, times, input.report().clone())
}

fn read(path: &Path) -> Result<(Vec<u64>, Vec<f64>, DecodeReport), DecodeError> {
    open(path, &DecodeOptions::default()).map(|mut input| read_all(&mut input))
}

fn clips() -> (tempfile::TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let paths = KINDS.iter().map(|(container, codec)| {
        let path = folder.path().join(format!("clip.{container}"));
        write_clip(&path, codec);
        path
    });
    let paths = paths.collect();
    (folder, paths)
}

#[test]
fn whole_clips_are_whole_with_times_of_the_stream() {
    let (_folder, paths) = clips();
    for path in paths {
        let (indices, times, report) = read(&path).unwrap();
        assert_eq!(indices, (0..FRAMES).collect::<Vec<_>>(), "{}", path.display());
        for (i, time) in times.iter().enumerate() {
            assert!((time - i as f64 / FPS).abs() < 2e-3, "{}: frame {i} at {time} s", path.display());
        }
        assert!(!report.is_damaged(), "{}: {report:?}", path.display());
        assert_eq!((report.expected, report.decoded, report.delivered), (FRAMES, FRAMES, FRAMES));
        assert_eq!(report.times_made_up, 0);
    }
}

#[test]
fn returned_memory_is_reused() {
    let (_folder, paths) = clips();
    let (mut fresh, mut reused) = {
        let input = || open(&paths[0], &DecodeOptions::default()).unwrap();
        (input(), input())
    };
    // A picture of another size cannot be reused and is dropped.
    reused.reuse(image::RgbImage::new(3, 2));
    let mut addresses = std::collections::BTreeSet::new();
    while let Some(frame) = reused.next_frame().unwrap() {
        assert_eq!(Some(&frame.image), fresh.next_frame().unwrap().map(|other| other.image).as_ref());
        addresses.insert(frame.image.as_ptr());
        reused.reuse(frame.image);
    }
    assert!(
        addresses.len() <= 2,
        "the first picture, and one more for the picture of another size: {}",
        addresses.len()
    );
}

#[test]
fn pixels_are_rgb_in_the_right_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("colours.png");
    let picture = image::RgbImage::from_fn(8, 4, |x, y| image::Rgb([x as u8 * 30, y as u8 * 60, 200]));
    picture.save(&path).unwrap();
    let mut input = open(&path, &DecodeOptions::default()).unwrap();
    assert_eq!(input.kind(), InputKind::Image);
    assert_eq!(input.next_frame().unwrap().unwrap().image, picture);
    // Colours also survive in a video: blue stays blue.
    let path = folder.path().join("blue.avi");
    let size = Size::new(64, 64);
    let fourcc = i32::from_le_bytes(*b"MJPG");
    let mut writer =
        VideoWriter::new_with_backend(path.to_str().unwrap(), CAP_FFMPEG, fourcc, FPS, size, true).unwrap();
    let blue = Mat::new_size_with_default(size, opencv::core::CV_8UC3, Scalar::new(255.0, 0.0, 0.0, 0.0));
    writer.write(&blue.unwrap()).unwrap();
    writer.release().unwrap();
    let frame = open(&path, &DecodeOptions::default()).unwrap().next_frame().unwrap().unwrap();
    let image::Rgb([red, green, blue]) = *frame.image.get_pixel(30, 30);
    assert!(red < 30 && green < 30 && blue > 220, "{red} {green} {blue}");
}

#[test]
fn stride_start_and_end_choose_by_time() {
    let (_folder, paths) = clips();
    let options = DecodeOptions { stride: 5, start_s: 0.9, end_s: Some(1.65), ..DecodeOptions::default() };
    for path in &paths {
        let (indices, _, report) = read_all(&mut open(path, &options).unwrap());
        assert_eq!(indices, [25, 30, 35, 40], "{}", path.display());
        assert!(!report.is_damaged(), "an end chosen by the caller is no damage");
    }
    let options = DecodeOptions { start_s: 100.0, ..DecodeOptions::default() };
    assert!(matches!(open(&paths[0], &options), Err(DecodeError::Option { .. })));
    let options = DecodeOptions { max_pixels: 159 * 96, ..DecodeOptions::default() };
    assert!(matches!(open(&paths[0], &options), Err(DecodeError::OverLimit { .. })));
}

#[test]
fn cut_clips_are_counted_or_refused_wherever_they_are_cut() {
    let (_folder, paths) = clips();
    for path in paths {
        let whole = std::fs::read(&path).unwrap();
        let name = path.display();
        let early = (0..1000).step_by(37);
        for length in early.chain((1..=20).map(|k| whole.len() * k / 21)) {
            std::fs::write(&path, &whole[..length]).unwrap();
            match read(&path) {
                Err(DecodeError::Damaged { .. } | DecodeError::NotMedia { .. }) => {}
                Err(other) => panic!("{name} cut at {length}: {other}"),
                Ok((indices, times, report)) => {
                    assert_eq!(report.expected, report.decoded + report.missing);
                    assert_eq!(report.delivered, indices.len() as u64);
                    assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{name}: times go forward");
                    // A transport stream that is cut between two packets looks complete.
                    let is_ts = path.extension().is_some_and(|e| e == "ts");
                    assert!(
                        report.is_damaged() || is_ts,
                        "{name} cut at {length} of {}: {report:?}",
                        whole.len()
                    );
                    if path.extension().is_some_and(|e| e == "avi") {
                        assert_eq!(report.expected, FRAMES, "{name} cut at {length}: {report:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn reading_continues_after_a_block_of_zeros() {
    let (_folder, paths) = clips();
    for path in paths {
        let mut bytes = std::fs::read(&path).unwrap();
        let (from, to) = (bytes.len() * 3 / 10, bytes.len() / 2);
        bytes[from..to].fill(0);
        std::fs::write(&path, &bytes).unwrap();
        let (indices, times, report) = read(&path).unwrap();
        let name = path.display();
        println!("{name}: {} of {}, {:?}", report.decoded, report.expected, report.damaged_stretches);
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(report.decoded >= FRAMES / 2, "{name}: {report:?}");
        assert!(*indices.last().unwrap() > FRAMES / 2 - 8, "{name}: {indices:?}");
        let last_s = *times.last().unwrap();
        if !["avi", "ts"].contains(&path.extension().unwrap().to_str().unwrap()) {
            assert!(
                last_s > 0.95 * FRAMES as f64 / FPS,
                "{name}: the times after the damage are wrong: {last_s}"
            );
        }
    }
}

#[test]
fn disguised_and_foreign_files_are_refused() {
    let (folder, paths) = clips();
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let script = format!("ffconcat version 1.0\nfile {}\n", paths[0].display());
    let playlist = format!("#EXTM3U\n#EXTINF:2,\n{}\n", paths[3].display());
    let video = std::fs::read(&paths[0]).unwrap();
    // These archives contain an intact video without compression.
    let zip = [b"PK\x03\x04\x14\0".as_slice(), &[0; 24], &video].concat();
    let tar = [b"lot.mp4".as_slice(), &[0; 250], b"ustar\0", &[0; 249], &video].concat();
    for path in [
        put("night.zip", &zip),
        put("zipped.mp4", &zip),
        put("night.tar", &tar),
        put("tarred.mp4", &tar),
        put("packed.mp4", b"\x1f\x8b\x08\0\0\0\0\0\0\x03"),
        put("empty.mp4", b""),
        put("script.mp4", script.as_bytes()),
        put("list.mp4", playlist.as_bytes()),
        put("list.m3u8", playlist.as_bytes()),
        put("call.sdp", b"v=0\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n"),
        put("letter.mp4", "Grüße, kein Video\n".as_bytes()),
        put("frame%03d.png", &video),
        put("noise.mp4", &[0x9e; 5000]),
    ] {
        let refused = open(&path, &DecodeOptions::default());
        assert!(matches!(refused, Err(DecodeError::NotMedia { .. })), "{}", path.display());
    }
    let address = open(Path::new("http://127.0.0.1/clip.mp4"), &DecodeOptions::default());
    assert!(matches!(address, Err(DecodeError::Stream { .. })));
    for absent in ["concat:a.ts|b.ts", "nothing.mp4"] {
        let refused = open(Path::new(absent), &DecodeOptions::default());
        assert!(matches!(refused, Err(DecodeError::Unreadable { .. })), "{absent}");
    }
}

#[test]
fn folders_are_clips_in_natural_order() {
    let folder = tempfile::tempdir().unwrap();
    let none = open(folder.path(), &DecodeOptions::default());
    assert!(matches!(none, Err(DecodeError::NotMedia { .. })));
    for i in 1..=12_u8 {
        let picture = image::RgbImage::from_pixel(16, 16, image::Rgb([i, i, i]));
        picture.save(folder.path().join(format!("f{i}.png"))).unwrap();
    }
    std::fs::write(folder.path().join("notes.txt"), "ignored").unwrap();
    std::fs::write(folder.path().join("f5.png"), "spoilt").unwrap();
    let options = DecodeOptions { image_fps: Some(10.0), ..DecodeOptions::default() };
    let mut input = open(folder.path(), &options).unwrap();
    assert_eq!((input.kind(), input.frames_hint()), (InputKind::Folder, Some(12)));
    assert!(input.report().warnings.iter().all(|warning| !warning.contains("frames/s")));
    let assumed = open(folder.path(), &DecodeOptions::default()).unwrap();
    let rate = "images have no times: 30 frames/s are assumed, and all speeds depend on this rate";
    assert!(assumed.report().warnings.iter().any(|warning| warning.starts_with(rate)));
    let mut seen = Vec::new();
    while let Some(frame) = input.next_frame().unwrap() {
        assert!((frame.stamp.time_s() - frame.stamp.index as f64 / 10.0).abs() < 1e-9);
        seen.push(frame.image.get_pixel(0, 0).0[0]);
    }
    assert_eq!(seen, [1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12]);
    assert_eq!((input.report().missing, input.report().expected), (1, 12));
    write_clip(&folder.path().join("z.avi"), b"MJPG");
    std::fs::write(folder.path().join("y.mp4"), "").unwrap();
    let content = FolderContent::of(folder.path()).unwrap();
    let names: Vec<_> = content.videos.iter().map(|path| path.file_name().unwrap()).collect();
    assert_eq!(
        (content.images.len(), content.ignored, names),
        (12, 1, vec!["y.mp4".as_ref(), "z.avi".as_ref()])
    );
    assert!(matches!(open(folder.path(), &options), Err(DecodeError::NotMedia { .. })));
}

/// Runs ffmpeg on a test pattern. Returns false if ffmpeg is not installed.
fn ffmpeg(arguments: &str, output: &Path) -> bool {
    let command = std::process::Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "lavfi", "-i", "testsrc=s=160x96:r=25:d=4"])
        .args(["-f", "lavfi", "-i", "sine=d=4"])
        .args(arguments.split_whitespace())
        .arg(output)
        .status();
    command.is_ok_and(|status| status.success())
}

#[test]
fn streams_as_cameras_write_them_are_whole() {
    let folder = tempfile::tempdir().unwrap();
    for (name, arguments, frames) in [
        // These clips have reordered pictures, edit lists, a sound track, no index at the end, or other containers.
        ("plain.mp4", "-map 0 -c:v libx264", 100),
        ("sound.mp4", "-map 0 -map 1 -c:v libx264 -c:a aac", 100),
        ("fragments.mp4", "-map 0 -c:v libx264 -movflags frag_keyframe+empty_moov", 100),
        ("plain.mkv", "-map 0 -map 1 -c:v libx264 -c:a aac", 100),
        ("plain.ts", "-map 0 -map 1 -c:v libx264 -c:a aac", 100),
        ("plain.avi", "-map 0 -c:v mpeg4", 100),
        ("plain.mpg", "-map 0 -c:v mpeg2video", 100),
        ("slow.mp4", "-map 0 -vf fps=5 -c:v libx264", 20),
        // These clips have a variable rate: only every fourth frame from the middle on.
        ("varying.mp4", "-map 0 -vf select=lt(n\\,50)+not(mod(n\\,4)) -fps_mode vfr -c:v libx264", 62),
        ("varying.mkv", "-map 0 -vf select=lt(n\\,50)+not(mod(n\\,4)) -fps_mode vfr -c:v libx264", 62),
    ] {
        let path = folder.path().join(name);
        if !ffmpeg(arguments, &path) {
            println!("skipped: ffmpeg is not installed or cannot make {name}");
            continue;
        }
        let (indices, times, report) = read(&path).unwrap();
        println!("{name}: {report:?}");
        assert_eq!(indices.len(), frames, "{name}");
        assert!(!report.is_damaged(), "{name}: {report:?}");
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{name}");
        let last_s = times[times.len() - 1];
        assert!((3.4..4.0).contains(&last_s), "{name} ends at {last_s} s");
    }
}

#[test]
fn files_without_pictures_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (name, arguments) in [("sound.m4a", "-map 1 -c:a aac"), ("sound.mka", "-map 1 -c:a aac")] {
        let path = folder.path().join(name);
        if !ffmpeg(arguments, &path) {
            println!("skipped: ffmpeg is not installed or cannot make {name}");
            continue;
        }
        assert!(matches!(read(&path), Err(DecodeError::Damaged { .. })), "{name}");
    }
}

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn real_archives_report_their_damage() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/virat");
    let (damaged, sound) = (data.join("virat_0002_lot.mp4"), data.join("virat_0401_lot.mp4"));
    let (_, times, report) = read(&damaged).unwrap();
    println!("{report:?}");
    assert_eq!((report.expected, report.decoded, report.missing), (117, 117, 0));
    assert_eq!(report.broken_packets, 1, "the first packet has a slice that FFmpeg refuses");
    assert!(report.is_damaged() && times.windows(2).all(|pair| pair[0] < pair[1]));
    let (_, times, report) = read(&sound).unwrap();
    assert_eq!((report.expected, report.missing, report.times_made_up), (50, 0, 0));
    assert!((times[49] - 49.0 / 30.0).abs() < 1e-3);
}
