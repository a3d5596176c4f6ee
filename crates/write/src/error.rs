//! Errors of reading and writing files. Their messages end with the path.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// An error of reading or writing a file or a folder.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The disk or the quota is full. Nothing appears under the final name.
    #[error("no space left while writing {path}")]
    DiskFull {
        /// The file.
        path: PathBuf,
    },
    /// The operating system reports an error: missing rights, a missing folder, a broken disk.
    #[error("cannot {doing}: {source}: {path}")]
    Io {
        /// The operation, such as `read`.
        doing: &'static str,
        /// The error of the operating system.
        source: io::Error,
        /// The file or folder.
        path: PathBuf,
    },
    /// A result exists already, and overwriting was not requested.
    #[error("there is a result already (use --overwrite or choose another folder): {path}")]
    Exists {
        /// The folder of the result.
        path: PathBuf,
    },
    /// Another run writes into the folder.
    #[error("another run is writing into {path}")]
    Locked {
        /// The folder.
        path: PathBuf,
    },
    /// The name of an input cannot name a folder.
    #[error("{stem:?} cannot be the name of a result folder: rename the input")]
    BadStem {
        /// The name.
        stem: String,
    },
    /// A number is infinite or NaN, which files must not contain.
    #[error("{what} is not finite: not written to {path}")]
    NotFinite {
        /// The number that is not finite.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// A result lacks the requested content.
    #[error("{what}: {path}")]
    Lacks {
        /// The missing content, and a remedy.
        what: String,
        /// The folder or file of the result.
        path: PathBuf,
    },
    /// A file does not have the documented form.
    #[error("{what}: {path}")]
    Malformed {
        /// The fault, with its line.
        what: String,
        /// The file.
        path: PathBuf,
    },
}

impl WriteError {
    /// Returns a function that turns an I/O error into the variant for its cause.
    pub(crate) fn io(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_path_buf();
        move |source| match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::DiskFull { path },
            // Bytes that are not text: the file is at fault, and another attempt will not help.
            io::ErrorKind::InvalidData => Self::malformed(&path, source),
            _ => Self::Io { doing, source, path },
        }
    }

    /// Returns a function that turns an error of a CSV file into the variant for its cause.
    pub fn csv(doing: &'static str, path: &Path) -> impl Fn(csv::Error) -> Self + use<> {
        let path = path.to_path_buf();
        move |error| {
            let what = error.to_string();
            match error.into_kind() {
                csv::ErrorKind::Io(source) => Self::io(doing, &path)(source),
                _ => Self::malformed(&path, what),
            }
        }
    }

    /// Creates the error for a file with invalid content.
    pub fn malformed(path: &Path, what: impl ToString) -> Self {
        Self::Malformed { what: what.to_string(), path: path.to_path_buf() }
    }
}
