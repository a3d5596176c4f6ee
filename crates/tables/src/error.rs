//! Errors of this crate.

use roadplane_write::WriteError;
use thiserror::Error;

/// An error that occurs while a report is made or written.
#[derive(Debug, Error)]
pub enum TableError {
    /// A table cannot be converted to CSV. The CSV text is written to memory, so this does not happen in practice.
    #[error("cannot convert a table to CSV: {0}")]
    Csv(#[from] csv::Error),
    /// A picture cannot be compressed.
    #[error("cannot compress a picture: {0}")]
    Picture(#[from] image::ImageError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}
