//! Errors of reading and comparing files. The path comes last in each message.

use std::path::{Path, PathBuf};

use thiserror::Error;

/// The reason why files cannot be compared.
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
    /// A file is not of its documented form.
    #[error("{what}: {}", path.display())]
    Malformed {
        /// The field or line, and the fault in it.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// Files do not belong together, or hold too little to compare.
    #[error("{what}")]
    Unsuitable {
        /// The fault, and how to correct it.
        what: String,
    },
}

impl MetricsError {
    /// Returns the error for a file that is not of its documented form.
    #[must_use]
    pub fn malformed(path: &Path, what: impl ToString) -> Self {
        Self::Malformed { what: what.to_string(), path: path.to_path_buf() }
    }

    /// Returns the error for a file that cannot be read.
    #[must_use]
    pub fn unreadable(path: &Path, source: std::io::Error) -> Self {
        Self::Unreadable { source, path: path.to_path_buf() }
    }
}
