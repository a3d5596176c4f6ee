//! Errors of records.

use thiserror::Error;

/// An error in a line of a record file.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The line is not JSON of the documented form.
    #[error("{0}")]
    Malformed(#[from] serde_json::Error),
    /// The line contains an impossible value.
    #[error("{what}")]
    Unsuitable {
        /// Description of the problem, for the user.
        what: String,
    },
}
