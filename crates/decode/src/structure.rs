//! Reads the structure of files without decoding them: files that end earlier than their own structure states, edit
//! lists, and the time of creation.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::{Content, sniff};

/// Largest number of top-level boxes of an MP4 file that are read.
const MAX_BOXES: usize = 10_000;

/// Whether the file ends before its outermost structure ends. A file with an unknown structure counts as complete.
pub(crate) fn is_cut_short(path: &Path, content: Content) -> bool {
    let cut = match content {
        Content::Mp4 => mp4_is_cut(path),
        Content::Avi => avi_is_cut(path),
        Content::Matroska => matroska_is_cut(path),
        Content::MpegTs => ts_is_cut(path),
        _ => Ok(false),
    };
    cut.unwrap_or(false)
}

/// Largest number of bytes of an MP4's movie box (`moov`) that are searched for edit lists.
const MAX_MOOV_BYTES: u64 = 64 << 20;

/// Seconds from the epoch of MP4 files (1904) to that of Unix (1970).
const MP4_EPOCH_S: u64 = 2_082_844_800;
/// Plausible times of a recording, s since 1970: the years 2000 to 2099. Cameras with an unset clock write others.
const PLAUSIBLE_S: std::ops::Range<u64> = 946_684_800..4_102_444_800;

/// Returns the time that the container of an MP4 file states as the time of its creation, UTC.
///
/// Returns `None` for other files, and if the container has no time from 2000 to 2099.
#[must_use]
pub fn creation_time(path: &Path) -> Option<SystemTime> {
    if sniff(path).ok()? != Content::Mp4 {
        return None;
    }
    let moov = movie_box(path)?;
    let header = child(&moov, b"mvhd")?;
    let seconds = match header.first()? {
        0 => u64::from(u32::from_be_bytes(*header.get(4..)?.first_chunk()?)),
        _ => u64::from_be_bytes(*header.get(4..)?.first_chunk()?),
    };
    let seconds = seconds.checked_sub(MP4_EPOCH_S).filter(|seconds| PLAUSIBLE_S.contains(seconds))?;
    UNIX_EPOCH.checked_add(Duration::from_secs(seconds))
}

/// Whether the edit list of an MP4 file leaves out a part of its video.
pub(crate) fn is_trimmed(path: &Path) -> bool {
    movie_box(path).is_some_and(|moov| trimmed_track(&moov).unwrap_or(false))
}

/// Returns the content of the movie box (`moov`) of an MP4 file.
fn movie_box(path: &Path) -> Option<Vec<u8>> {
    let mut file = File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    let mut at = 0;
    for _ in 0..MAX_BOXES {
        file.seek(SeekFrom::Start(at)).ok()?;
        let mut header = [0_u8; 16];
        file.read_exact(if length - at >= 16 { &mut header } else { &mut header[..8] }).ok()?;
        let [a, b, c, d, name @ .., _, _, _, _, _, _, _, _] = header;
        let [_, _, _, _, _, _, _, _, large @ ..] = header;
        let size = match u32::from_be_bytes([a, b, c, d]) {
            1 => u64::from_be_bytes(large),
            size => u64::from(size),
        };
        if &name == b"moov" {
            let mut bytes = Vec::new();
            file.seek(SeekFrom::Start(at + 8)).ok()?;
            file.take(size.saturating_sub(8).min(MAX_MOOV_BYTES)).read_to_end(&mut bytes).ok()?;
            return Some(bytes);
        }
        at = at.checked_add(size.max(8)).filter(|&next| next + 8 <= length)?;
    }
    None
}

/// Returns the contents of the first MP4 box with this name, or `None` if there is no such box.
fn child<'a>(bytes: &'a [u8], name: &[u8; 4]) -> Option<&'a [u8]> {
    children(bytes).find(|(found, _)| found == name).map(|(_, body)| body)
}

fn children(mut bytes: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let size = u32::from_be_bytes(*bytes.first_chunk()?) as usize;
        let name = *bytes.get(4..)?.first_chunk()?;
        let body = bytes.get(8..size)?;
        bytes = &bytes[size..];
        Some((name, body))
    })
}

/// Whether the edit list in a movie box (`moov`) leaves out a part of the video track. It does so if it leaves out more
/// than a second at the start or more than 15 ms at the end. Returns `None` if the movie box cannot be read.
///
/// Reordered pictures are delayed by the first composition offset. Most encoders let the edit list begin at this
/// offset. With other encoders, it begins at zero, and the same time is left out at the end.
fn trimmed_track(moov: &[u8]) -> Option<bool> {
    let number = |bytes: &[u8], at: usize| Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?));
    // Boxes of version 0 have times of 4 bytes, and boxes of version 1 have times of 8 bytes.
    let scale_and_duration = |header: &[u8]| match header.first()? {
        0 => Some((f64::from(number(header, 12)?), f64::from(number(header, 16)?))),
        _ => {
            let duration = u64::from_be_bytes(*header.get(24..)?.first_chunk()?);
            Some((f64::from(number(header, 20)?), duration as f64))
        }
    };
    let (movie_scale, _) = scale_and_duration(child(moov, b"mvhd")?)?;
    for (_, trak) in children(moov).filter(|(name, _)| name == b"trak") {
        let Some(mdia) = child(trak, b"mdia") else { continue };
        if child(mdia, b"hdlr")?.get(8..12)? != b"vide" {
            continue;
        }
        let (scale, duration) = scale_and_duration(child(mdia, b"mdhd")?)?;
        let Some(elst) = child(trak, b"edts").and_then(|edts| child(edts, b"elst")) else {
            return Some(false);
        };
        let entries = number(elst, 4)?;
        if entries != 1 || elst.first() != Some(&0) {
            return Some(true); // pauses, repeats and times of 8 bytes are not distinguished
        }
        let shown_s = f64::from(number(elst, 8)?) / movie_scale;
        let ctts = child(mdia, b"minf").and_then(|minf| child(child(minf, b"stbl")?, b"ctts"));
        let delay = ctts.and_then(|ctts| number(ctts, 12)).map_or(0.0, f64::from);
        let from_s = f64::from(number(elst, 12)?) / scale;
        return Some(from_s > 1.0 || shown_s + from_s < (duration + delay) / scale - 0.015);
    }
    None
}

fn mp4_is_cut(path: &Path) -> std::io::Result<bool> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut at = 0_u64;
    for _ in 0..MAX_BOXES {
        if at == length {
            return Ok(false);
        }
        let mut header = [0_u8; 16];
        if length - at < 8 {
            return Ok(true);
        }
        file.seek(SeekFrom::Start(at))?;
        let long = length - at >= 16;
        file.read_exact(if long { &mut header } else { &mut header[..8] })?;
        let [a, b, c, d, _, _, _, _, large @ ..] = header;
        let size = match u32::from_be_bytes([a, b, c, d]) {
            0 => return Ok(false), // this box extends to the end of the file
            1 if long => u64::from_be_bytes(large),
            size => u64::from(size),
        };
        match at.checked_add(size) {
            Some(next) if size >= 8 && next <= length => at = next,
            Some(next) if next > length => return Ok(true),
            _ => return Ok(false), // not a box: the file is broken in another way
        }
    }
    Ok(false)
}

/// Whether a transport stream ends inside a packet. A packet has 188 bytes, or 192 bytes if a time stamp comes before
/// it.
fn ts_is_cut(path: &Path) -> std::io::Result<bool> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut first = [0];
    file.read_exact(&mut first)?;
    Ok(length % if first == [0x47] { 188 } else { 192 } != 0)
}

fn avi_is_cut(path: &Path) -> std::io::Result<bool> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut header = [0_u8; 8];
    file.read_exact(&mut header)?;
    let [_, _, _, _, size @ ..] = header;
    Ok(u64::from(u32::from_le_bytes(size)) + 8 > length)
}

/// Reads a size from a Matroska file (an EBML number with its length marker). Returns the value and its number of
/// bytes, or `None` for the reserved value that means "unknown".
fn ebml_size(bytes: &[u8]) -> Option<(u64, usize)> {
    let first = *bytes.first()?;
    let length = first.leading_zeros() as usize + 1;
    let bytes = bytes.get(..length)?;
    let value = bytes.iter().fold(0_u64, |value, byte| value << 8 | u64::from(*byte));
    let mask = (1_u64 << (7 * length)) - 1;
    (length <= 8 && value & mask != mask).then_some((value & mask, length))
}

fn matroska_is_cut(path: &Path) -> std::io::Result<bool> {
    const SEGMENT: [u8; 4] = [0x18, 0x53, 0x80, 0x67];
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut head = Vec::new();
    file.take(4096).read_to_end(&mut head)?;
    let end_of_segment = || {
        let (header, digits) = ebml_size(head.get(4..)?)?;
        let segment = 4 + digits + usize::try_from(header).ok()?;
        let rest = head.get(segment..)?.strip_prefix(&SEGMENT)?;
        let (size, digits) = ebml_size(rest)?;
        Some((segment + 4 + digits) as u64 + size)
    };
    Ok(end_of_segment().is_some_and(|end| end > length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_beyond_the_end_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let whole = [&[0, 0, 0, 12][..], b"ftypisom", &[0, 0, 0, 20], b"mdat", &[7; 12]].concat();
        for length in 0..=whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let between_boxes = [0, 12, whole.len()].contains(&length);
            assert_eq!(is_cut_short(&path, Content::Mp4), !between_boxes, "{length} bytes");
        }
    }

    #[test]
    fn the_container_states_the_time_of_its_creation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let box_of =
            |name: &[u8; 4], body: &[u8]| [&(body.len() as u32 + 8).to_be_bytes()[..], name, body].concat();
        let read = |version: u8, time: &[u8]| {
            let mvhd = [&[version, 0, 0, 0][..], time, &[0; 100]].concat();
            let file = [box_of(b"ftyp", b"isom\0\0\0\0"), box_of(b"moov", &box_of(b"mvhd", &mvhd))];
            std::fs::write(&path, file.concat()).unwrap();
            creation_time(&path).map(|time| time.duration_since(UNIX_EPOCH).unwrap().as_secs())
        };
        let stated = 1_769_896_800 + MP4_EPOCH_S;
        assert_eq!(read(0, &(stated as u32).to_be_bytes()), Some(1_769_896_800));
        assert_eq!(read(1, &stated.to_be_bytes()), Some(1_769_896_800));
        assert_eq!((read(0, &[0; 4]), read(1, &[0xff; 8])), (None, None));
        std::fs::write(&path, "no video").unwrap();
        assert_eq!(creation_time(&path), None);
    }
}
