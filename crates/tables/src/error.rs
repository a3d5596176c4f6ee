//! Errors of this crate.

use roadplane_write::WriteError;
use thiserror::Error;

/// An error of making or writing a report.
#[derive(Debug, Error)]
pub enum TableError {
    /// A table cannot be converted to CSV. Text in memory never causes this.
    #[error("cannot convert a table to CSV: {0}")]
    Csv(#[from] csv::Error),
    /// A picture cannot be compressed.
    #[error("cannot compress a picture: {0}")]
    Picture(#[from] image::ImageError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}
