//! Errors of this crate.

use std::path::PathBuf;

use thiserror::Error;

/// An error of drawing or writing pictures.
#[derive(Debug, Error)]
pub enum ViewError {
    /// OpenCV cannot draw or encode.
    #[error("cannot draw: {0}")]
    Drawing(#[from] opencv::Error),
    /// A picture cannot be compressed.
    #[error("cannot compress a picture: {0}")]
    Compressing(#[from] image::ImageError),
    /// The player's data cannot be written as JSON.
    #[error("cannot write the data of the report: {what}")]
    Data {
        /// The reason.
        what: String,
    },
    /// OpenCV has no codec that can write the video.
    #[error("no codec can write the video: {}", path.display())]
    NoCodec {
        /// The video.
        path: PathBuf,
    },
    /// The operating system reports an error.
    #[error("cannot write: {source}: {}", path.display())]
    Io {
        /// The error of the operating system.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
}
