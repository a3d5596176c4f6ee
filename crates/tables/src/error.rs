//! What can go wrong.

use roadplane_write::WriteError;
use thiserror::Error;

/// Why a report was not made or written.
#[derive(Debug, Error)]
pub enum TableError {
    /// A table cannot be made CSV, which text in memory never causes.
    #[error("a table cannot be made CSV: {0}")]
    Csv(#[from] csv::Error),
    /// A picture cannot be compressed.
    #[error("a picture cannot be compressed: {0}")]
    Picture(#[from] image::ImageError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}
