//! Lists the media files in a folder. Reads a folder of images as a clip, and a single image as a clip of one frame.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use roadplane_base::FrameStamp;

use crate::options::{ASSUMED_IMAGE_FPS, Verdict};
use crate::sniff::{has_image_name, has_video_name, sniff};
use crate::still;
use crate::{Content, DecodeError, DecodeOptions, DecodeReport, Decoded};

/// The media files in a folder, without its subfolders and hidden files.
///
/// Files are sorted by name, and numbers in the names are compared as numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FolderContent {
    /// Paths of the images.
    pub images: Vec<PathBuf>,
    /// Paths of the videos, including damaged files with the name of a video.
    pub videos: Vec<PathBuf>,
    /// Number of all other files.
    pub ignored: u64,
}

impl FolderContent {
    /// Lists the media files in a folder.
    ///
    /// # Errors
    /// [`DecodeError::Unreadable`] if the folder cannot be read.
    pub fn of(folder: &Path) -> Result<Self, DecodeError> {
        let unreadable = |source| DecodeError::Unreadable { source, path: folder.to_path_buf() };
        let mut content = Self::default();
        for entry in std::fs::read_dir(folder).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            if hidden || path.is_dir() {
                continue;
            }
            // A damaged image must still count as a frame, and a damaged video as a clip. So the name alone can decide
            // here. The content is checked when the file is read.
            match if has_image_name(&path) { Ok(Content::Png) } else { sniff(&path) } {
                Ok(content_of_file) if content_of_file.is_image() => content.images.push(path),
                Ok(_) => content.videos.push(path),
                Err(_) if has_video_name(&path) => content.videos.push(path),
                Err(_) => content.ignored += 1,
            }
        }
        for paths in [&mut content.images, &mut content.videos] {
            paths.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
        }
        Ok(content)
    }
}

/// The images of a clip, in the order of its frames.
pub(crate) struct Images {
    paths: std::vec::IntoIter<PathBuf>,
    count: u64,
    next_index: u64,
    size: Option<(u32, u32)>,
}

impl Images {
    /// Creates a clip of one frame.
    pub(crate) fn single(path: &Path) -> Self {
        Self::new(vec![path.to_path_buf()])
    }

    fn new(paths: Vec<PathBuf>) -> Self {
        Self { count: paths.len() as u64, paths: paths.into_iter(), next_index: 0, size: None }
    }

    /// Opens all images in a folder.
    pub(crate) fn in_folder(
        folder: &Path,
        options: &DecodeOptions,
        report: &mut DecodeReport,
    ) -> Result<Self, DecodeError> {
        let FolderContent { images: paths, videos, ignored } = FolderContent::of(folder)?;
        if let Some(path) = videos.into_iter().next() {
            let what = "a folder may contain images only; pass its videos one by one".to_owned();
            return Err(DecodeError::NotMedia { what, path });
        }
        if paths.is_empty() {
            let what = "the folder contains no image and no video".to_owned();
            return Err(DecodeError::NotMedia { what, path: folder.to_path_buf() });
        }
        if ignored > 0 {
            report.warn(format!("{ignored} files of the folder are neither image nor video and are ignored"));
        }
        if paths.len() > 1 && options.image_fps.is_none() {
            report.warn(format!(
                "images have no times: {ASSUMED_IMAGE_FPS} frames/s are assumed, and all speeds depend on this rate; \
                 give the true rate with --image-fps"
            ));
        }
        Ok(Self::new(paths))
    }

    /// Returns the number of images.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// Returns the next frame that the options choose, or `None` at the end.
    pub(crate) fn next(
        &mut self,
        options: &DecodeOptions,
        report: &mut DecodeReport,
    ) -> Result<Option<Decoded>, DecodeError> {
        for path in self.paths.by_ref() {
            let index = self.next_index;
            self.next_index += 1;
            let pts_nanos = (index as f64 / options.image_rate() * 1e9).round() as i64;
            let stamp = FrameStamp { index, pts_nanos };
            match options.verdict(index, pts_nanos, report.delivered) {
                Verdict::Over => return Ok(None),
                Verdict::Skip => report.decoded_one(),
                Verdict::Take => {
                    let read = sniff(&path).and_then(|content| still::read(&path, content, options));
                    let image = match read {
                        Ok(image) if self.size.get_or_insert(image.dimensions()) == &image.dimensions() => {
                            image
                        }
                        // A single image has no other frame that could be delivered.
                        Err(error) if self.count == 1 => return Err(error),
                        other => {
                            let why = other.err().map_or_else(
                                || {
                                    format!(
                                        "its size differs from that of the first image: {}",
                                        path.display()
                                    )
                                },
                                |error| error.to_string(),
                            );
                            report.left_out(index, stamp.time_s(), &why);
                            continue;
                        }
                    };
                    report.decoded_one();
                    return Ok(Some(Decoded { stamp, image: Some(image) }));
                }
            }
        }
        Ok(None)
    }
}

/// Compares two names. Numbers in them are compared as numbers: `a2` comes before `a10`.
fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let (l, r) = (left.chars().next(), right.chars().next());
        let (Some(l), Some(r)) = (l, r) else {
            return left.len().cmp(&right.len()).then_with(|| a.cmp(b));
        };
        if l.is_ascii_digit() && r.is_ascii_digit() {
            let (number_l, rest_l) = split_number(left);
            let (number_r, rest_r) = split_number(right);
            let order = number_l.len().cmp(&number_r.len()).then_with(|| number_l.cmp(number_r));
            if order != Ordering::Equal {
                return order;
            }
            (left, right) = (rest_l, rest_r);
        } else if l == r {
            (left, right) = (&left[l.len_utf8()..], &right[r.len_utf8()..]);
        } else {
            return l.cmp(&r);
        }
    }
}

/// Splits a text after its leading number. Returns the number's digits without leading zeros, and the rest of the text.
fn split_number(text: &str) -> (&str, &str) {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    (digits.trim_start_matches('0'), rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = ["f10.png", "f9.png", "f010b.png", "e1.png", "f1.png", "f.png"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["e1.png", "f.png", "f1.png", "f9.png", "f10.png", "f010b.png"]);
        assert_eq!(natural_order("f01", "f1"), Ordering::Less);
        assert_eq!(natural_order("f99999999999999999999999", "f100000000000000000000000"), Ordering::Less);
    }
}
