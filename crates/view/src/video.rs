//! Writing of pictures to a video file. The file gets its final name when it is complete.

use std::path::{Path, PathBuf};

use image::RgbImage;
use opencv::core::{Mat, MatTraitConst as _, Size};
use opencv::imgproc;
use opencv::videoio::{VideoWriter, VideoWriterTrait as _, VideoWriterTraitConst as _};

use crate::ViewError;

/// FourCC codes of the codecs that are tried, best first.
const CODECS: [[char; 4]; 2] = [['a', 'v', 'c', '1'], ['m', 'p', '4', 'v']];

/// An MP4 video in progress.
pub struct VideoSink {
    writer: VideoWriter,
    partial: PathBuf,
    path: PathBuf,
}

impl VideoSink {
    /// Starts a video with the final name `path`. `width` and `height` are the size of the pictures, px.
    ///
    /// # Errors
    /// [`ViewError::NoCodec`], [`ViewError::Drawing`].
    pub fn create(path: &Path, width: u32, height: u32, frames_per_s: f64) -> Result<Self, ViewError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let partial = path.with_file_name(format!(".partial-{name}"));
        let size = Size::new(i32::try_from(width).unwrap_or(0), i32::try_from(height).unwrap_or(0));
        for [a, b, c, d] in CODECS {
            let codec = VideoWriter::fourcc(a, b, c, d)?;
            let writer = VideoWriter::new(&partial, codec, frames_per_s.max(1.0), size, true)?;
            if writer.is_opened()? {
                return Ok(Self { writer, partial, path: path.to_path_buf() });
            }
        }
        Err(ViewError::NoCodec { path: path.to_path_buf() })
    }

    /// Appends a picture as the next frame.
    ///
    /// # Errors
    /// [`ViewError::Drawing`].
    pub fn write(&mut self, picture: &RgbImage) -> Result<(), ViewError> {
        let rows = Mat::from_slice(picture.as_raw())?;
        let rgb = rows.reshape(3, i32::try_from(picture.height()).unwrap_or(0))?;
        let mut bgr = Mat::default();
        imgproc::cvt_color_def(&rgb, &mut bgr, imgproc::COLOR_RGB2BGR)?;
        Ok(self.writer.write(&bgr)?)
    }

    /// Completes the video and renames it to its final name.
    ///
    /// # Errors
    /// [`ViewError::Drawing`], [`ViewError::Io`].
    pub fn finish(mut self) -> Result<(), ViewError> {
        self.writer.release()?;
        std::fs::File::open(&self.partial)
            .and_then(|file| file.sync_all())
            .and_then(|()| std::fs::rename(&self.partial, &self.path))
            .map_err(|source| ViewError::Io { source, path: self.path.clone() })
    }
}

/// Removes the file of an unfinished video. After [`VideoSink::finish`], nothing is removed.
impl Drop for VideoSink {
    fn drop(&mut self) {
        // The writer is closed first. Otherwise the encoder would continue to write.
        self.writer.release().ok();
        std::fs::remove_file(&self.partial).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_appears_when_it_is_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.mp4");
        let mut sink = VideoSink::create(&path, 64, 48, 10.0).unwrap();
        for _ in 0..5 {
            sink.write(&RgbImage::new(64, 48)).unwrap();
        }
        assert!(!path.exists());
        drop(VideoSink::create(&folder.path().join("stopped.mp4"), 64, 48, 10.0).unwrap());
        sink.finish().unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() > 100);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
