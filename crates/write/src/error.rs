//! Errors in reading and writing files. A message about a file or folder ends with its path.

use std::io;
use std::path::{Path, PathBuf};

use parquet::errors::ParquetError;
use thiserror::Error;

/// An error in reading or writing a file or a folder.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The disk or the quota is full. No file or folder appears under the final name.
    #[error("no space left while writing {path}")]
    DiskFull {
        /// Path of the file.
        path: PathBuf,
    },
    /// The operating system reports an error, such as missing rights, a missing folder or a broken disk.
    #[error("cannot {doing}: {source}: {path}")]
    Io {
        /// The operation that failed, such as `read`.
        doing: &'static str,
        /// The error of the operating system.
        source: io::Error,
        /// Path of the file or folder.
        path: PathBuf,
    },
    /// A result exists already, and overwriting was not requested.
    #[error("there is a result already (use --overwrite or choose another folder): {path}")]
    Exists {
        /// Path of the result folder.
        path: PathBuf,
    },
    /// Another run is writing into the folder.
    #[error("another run is writing into {path}")]
    Locked {
        /// Path of the folder.
        path: PathBuf,
    },
    /// The name of an input is not valid as the name of a folder.
    #[error("{stem:?} cannot be the name of a result folder: rename the input")]
    BadStem {
        /// The invalid name.
        stem: String,
    },
    /// A number is infinite or NaN. Files must not contain such numbers.
    #[error("{what} is not finite: not written to {path}")]
    NotFinite {
        /// Name of the number that is not finite.
        what: String,
        /// Path of the file.
        path: PathBuf,
    },
    /// A result lacks the requested content.
    #[error("{what}: {path}")]
    Lacks {
        /// The missing content, and advice on how to get it.
        what: String,
        /// Path of the result's folder or file.
        path: PathBuf,
    },
    /// The content of a file does not have the documented format.
    #[error("{what}: {path}")]
    Malformed {
        /// The fault, with its line number if the file has lines.
        what: String,
        /// Path of the file.
        path: PathBuf,
    },
}

impl WriteError {
    /// Returns a function that converts an I/O error to the variant for its cause. `doing` is the operation, such as
    /// `read`.
    pub fn io(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_path_buf();
        move |source| match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::DiskFull { path },
            // The file contains bytes that are not text. Another attempt would fail in the same manner.
            io::ErrorKind::InvalidData => Self::malformed(&path, source),
            _ => Self::Io { doing, source, path },
        }
    }

    /// Returns a function that converts a CSV error to the variant for its cause. `doing` is the operation, such as
    /// `read`.
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

    /// Returns a function that converts an error of the Parquet library to the variant for its cause.
    ///
    /// The library wraps I/O errors. The kind of a wrapped I/O error determines the variant.
    pub fn parquet(path: &Path) -> impl Fn(ParquetError) -> Self + use<> {
        let path = path.to_path_buf();
        move |error| match error {
            ParquetError::External(source) => match source.downcast::<io::Error>() {
                Ok(source) => Self::io("write", &path)(*source),
                Err(other) => Self::malformed(&path, other),
            },
            other => Self::malformed(&path, other),
        }
    }

    /// Creates a [`WriteError::Malformed`] for a file with invalid content. `what` describes the fault.
    pub fn malformed(path: &Path, what: impl ToString) -> Self {
        Self::Malformed { what: what.to_string(), path: path.to_path_buf() }
    }
}
