//! Errors in drawing and writing pictures.

use std::path::PathBuf;

use thiserror::Error;

/// An error in drawing or writing pictures.
#[derive(Debug, Error)]
pub enum ViewError {
    /// OpenCV cannot draw into or encode a picture.
    #[error("cannot draw: {0}")]
    Drawing(#[from] opencv::Error),
    /// A picture cannot be compressed.
    #[error("cannot compress a picture: {0}")]
    Compressing(#[from] image::ImageError),
    /// The data of the report's interactive player cannot be written as JSON.
    #[error("cannot write the data of the report: {what}")]
    Data {
        /// The reason why the data cannot be written.
        what: String,
    },
    /// OpenCV has no codec that can write the video.
    #[error("no codec can write the video: {}", path.display())]
    NoCodec {
        /// Path of the video file.
        path: PathBuf,
    },
    /// The operating system reports an error in writing a file.
    #[error("cannot write: {source}: {}", path.display())]
    Io {
        /// The error of the operating system.
        source: std::io::Error,
        /// Path of the file.
        path: PathBuf,
    },
}
