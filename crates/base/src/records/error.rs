//! What can be wrong with a record.

use thiserror::Error;

/// What is wrong with a line of a record file.
#[derive(Debug, Error)]
pub enum RecordError {
    /// Not JSON of the documented form.
    #[error("{0}")]
    Malformed(#[from] serde_json::Error),
    /// A number that cannot be.
    #[error("{what}")]
    Unsuitable {
        /// What is unsuitable.
        what: String,
    },
}
