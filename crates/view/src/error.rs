//! What can go wrong.

use std::path::PathBuf;

use thiserror::Error;

/// Why a picture was not made.
#[derive(Debug, Error)]
pub enum ViewError {
    /// OpenCV refused to draw or to encode.
    #[error("drawing: {0}")]
    Drawing(#[from] opencv::Error),
    /// A picture cannot be compressed.
    #[error("compressing a picture: {0}")]
    Compressing(#[from] image::ImageError),
    /// What a page plays cannot be written down.
    #[error("the page's data: {what}")]
    Data {
        /// Why.
        what: String,
    },
    /// No codec for the video.
    #[error("no codec to write the video with: {}", path.display())]
    NoCodec {
        /// The video.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("cannot write: {source}: {}", path.display())]
    Io {
        /// Its answer.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
}
