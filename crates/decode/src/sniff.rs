//! Recognises the kind of a file by its first bytes. Only the kinds in [`Content`] reach a codec. FFmpeg would also
//! open playlists, concatenation scripts and patterns that name other files.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use crate::DecodeError;

/// Number of bytes that are read from a file to recognise its kind. They contain at least three packets of a transport
/// stream.
const HEAD_BYTES: u64 = 1024;

/// The kind of a file that can be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// MP4, QuickTime and related formats.
    Mp4,
    /// Matroska or WebM.
    Matroska,
    /// AVI.
    Avi,
    /// MPEG transport stream.
    MpegTs,
    /// MPEG program stream.
    MpegPs,
    /// H.264 stream without a container. Such a stream contains no frame times.
    H264,
    /// JPEG image.
    Jpeg,
    /// PNG image.
    Png,
}

impl Content {
    /// Whether the file is a single image.
    #[must_use]
    pub fn is_image(self) -> bool {
        matches!(self, Self::Jpeg | Self::Png)
    }
}

/// Returns the kind of a file, according to its content.
///
/// # Errors
/// [`DecodeError::Unreadable`] if the file cannot be read, [`DecodeError::NotMedia`] if its kind is not in [`Content`].
pub fn sniff(path: &Path) -> Result<Content, DecodeError> {
    let unreadable = |source| DecodeError::Unreadable { source, path: path.to_path_buf() };
    let not_media = |what: &str| DecodeError::NotMedia { what: what.to_owned(), path: path.to_path_buf() };
    // This check comes before opening, because opening a pipe would wait for its writer.
    if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(not_media("it is no regular file"));
    }
    let mut head = Vec::new();
    File::open(path).and_then(|f| f.take(HEAD_BYTES).read_to_end(&mut head)).map_err(unreadable)?;
    let content = recognise(&head).map_err(not_media)?;
    // FFmpeg treats a file with the name of an image as a pattern of numbered files, whatever its content.
    if !content.is_image() && has_image_name(path) {
        return Err(not_media("it is a video with the name of an image: rename it"));
    }
    Ok(content)
}

/// Whether the file's name has the extension of an image.
pub(crate) fn has_image_name(path: &Path) -> bool {
    has_extension(path, &["jpg", "jpeg", "png", "bmp", "gif", "tif", "tiff", "webp", "ppm"])
}

/// Whether the file's name has the extension of a video.
pub(crate) fn has_video_name(path: &Path) -> bool {
    has_extension(path, &["mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "mpeg"])
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension()
        .and_then(|extension| extension.to_str())
        .is_some_and(|extension| extensions.iter().any(|name| extension.eq_ignore_ascii_case(name)))
}

fn recognise(head: &[u8]) -> Result<Content, &'static str> {
    let at = |offset: usize, what: &[u8]| head.get(offset..).is_some_and(|rest| rest.starts_with(what));
    let sync = |step: usize, first: usize| (0..3).all(|k| head.get(first + k * step) == Some(&0x47));
    // Every H.264 stream that can be decoded from its start begins with an access unit delimiter or sequence
    // parameters.
    let h264 = |nal: Option<&u8>| nal.is_some_and(|b| b & 0x80 == 0 && matches!(b & 0x1f, 7 | 9));
    if head.is_empty() {
        Err("the file is empty")
    } else if at(0, &[0xff, 0xd8, 0xff]) {
        Ok(Content::Jpeg)
    } else if at(0, b"\x89PNG\r\n\x1a\n") {
        Ok(Content::Png)
    } else if [&b"ftyp"[..], b"moov", b"mdat", b"wide", b"pnot"].iter().any(|name| at(4, name)) {
        Ok(Content::Mp4)
    } else if at(0, &[0x1a, 0x45, 0xdf, 0xa3]) {
        Ok(Content::Matroska)
    } else if at(0, b"RIFF") && at(8, b"AVI ") {
        Ok(Content::Avi)
    } else if sync(188, 0) || sync(192, 4) {
        Ok(Content::MpegTs)
    } else if at(0, &[0, 0, 1, 0xba]) {
        Ok(Content::MpegPs)
    } else if (at(0, &[0, 0, 0, 1]) && h264(head.get(4))) || (at(0, &[0, 0, 1]) && h264(head.get(3))) {
        Ok(Content::H264)
    } else if at(0, b"GIF8") || at(0, b"BM") || at(0, b"II*\0") || at(0, b"MM\0*") || at(8, b"WEBP") {
        Err("this kind of image is not supported: use PNG or JPEG")
    } else if at(0, b"RIFF") || at(0, b"OggS") || at(0, b"ID3") || at(0, b"fLaC") {
        Err("it is sound, or its container is not supported")
    } else if std::str::from_utf8(&head[..head.len().saturating_sub(4)]).is_ok() && !head.contains(&0) {
        Err("it is a text file; roadplane does not follow lists of files")
    } else {
        Err("unknown content")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_recognised_by_content() {
        let ts: Vec<u8> = (0..600).map(|i| if i % 188 == 0 { 0x47 } else { 0 }).collect();
        for (head, kind) in [
            (&b"\0\0\0\x20ftypisom\0\0\x02\0"[..], Content::Mp4),
            (b"\x1a\x45\xdf\xa3\x01\0\0\0", Content::Matroska),
            (b"RIFF\x10\0\0\0AVI LIST", Content::Avi),
            (b"\0\0\x01\xba\x44", Content::MpegPs),
            (b"\0\0\0\x01\x67\x64", Content::H264),
            (b"\xff\xd8\xff\xe0", Content::Jpeg),
            (b"\x89PNG\r\n\x1a\n", Content::Png),
            (&ts, Content::MpegTs),
        ] {
            assert_eq!(recognise(head), Ok(kind));
        }
    }

    #[test]
    fn files_that_are_no_media_are_refused() {
        for head in [
            &b""[..],
            b"ffconcat version 1.0\nfile /etc/passwd\n",
            b"#EXTM3U\n#EXTINF:10,\nhttp://example.org/a.ts\n",
            b"v=0\no=- 0 0 IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n",
            b"RIFF\x10\0\0\0WAVEfmt ",
            b"GIF89a",
            b"\x7fELF\x02\x01\x01\0",
            b"\0",
            b"\0\0\0\x01\x41\x9a",
        ] {
            assert!(recognise(head).is_err(), "{head:?}");
        }
    }
}
