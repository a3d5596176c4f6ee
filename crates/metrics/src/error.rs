//! The error type of this crate. A message about a file ends with the path of the file.

use std::path::{Path, PathBuf};

use thiserror::Error;

/// The reason why files cannot be read or compared.
#[derive(Debug, Error)]
pub enum MetricsError {
    /// A file cannot be read.
    #[error("cannot be read: {source}: {}", path.display())]
    Unreadable {
        /// The error of the operating system.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// A file does not have its documented format.
    #[error("{what}: {}", path.display())]
    Malformed {
        /// The faulty field or line, and the fault.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// Files belong to different inputs, or contain too little data for a comparison.
    #[error("{what}")]
    Unsuitable {
        /// The fault, and how to correct it.
        what: String,
    },
}

impl MetricsError {
    /// Returns the error for a file that does not have its documented format. `what` names the faulty field or line,
    /// and the fault.
    #[must_use]
    pub fn malformed(path: &Path, what: impl ToString) -> Self {
        Self::Malformed { what: what.to_string(), path: path.to_path_buf() }
    }

    /// Returns the error for a file that cannot be read. `source` is the error of the operating system.
    #[must_use]
    pub fn unreadable(path: &Path, source: std::io::Error) -> Self {
        Self::Unreadable { source, path: path.to_path_buf() }
    }
}
