//! What can go wrong, by who can mend it. Paths stand last in the messages.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why something was not written or read.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The disk or the quota is full. Waiting does not help; nothing appears under the final name.
    #[error("no space left while writing {path}")]
    DiskFull {
        /// The file.
        path: PathBuf,
    },
    /// The operating system refused: rights, a missing folder, a broken disk.
    #[error("cannot {doing}: {source}: {path}")]
    Io {
        /// What was tried.
        doing: &'static str,
        /// The system's answer.
        source: io::Error,
        /// The file or folder.
        path: PathBuf,
    },
    /// A result is there already and overwriting was not asked for.
    #[error("there is a result already (overwrite or choose another folder): {path}")]
    Exists {
        /// The result's folder.
        path: PathBuf,
    },
    /// Another run writes into the folder.
    #[error("another run is writing into {path}")]
    Locked {
        /// The folder.
        path: PathBuf,
    },
    /// The name of an input cannot name a folder.
    #[error("cannot name a result folder {stem:?}")]
    BadStem {
        /// The name.
        stem: String,
    },
    /// A number that a file must not hold.
    #[error("{what} is not finite: not written to {path}")]
    NotFinite {
        /// Which number.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// A result holds nothing of what is asked of it.
    #[error("{what}: {path}")]
    Lacks {
        /// What is not there, and what would help.
        what: String,
        /// The result.
        path: PathBuf,
    },
    /// A file that we read back is not of the documented form.
    #[error("{what}: {path}")]
    Malformed {
        /// What is wrong, with the line.
        what: String,
        /// The file.
        path: PathBuf,
    },
}

impl WriteError {
    /// Turns an I/O error into the variant by fault.
    pub(crate) fn io(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_path_buf();
        move |source| match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::DiskFull { path },
            // Bytes that are no text: the file is at fault, and trying again will not help.
            io::ErrorKind::InvalidData => Self::malformed(&path, source),
            _ => Self::Io { doing, source, path },
        }
    }

    /// Turns an error of a CSV file into the variant by fault.
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

    /// A file's content that cannot be used.
    pub fn malformed(path: &Path, what: impl ToString) -> Self {
        Self::Malformed { what: what.to_string(), path: path.to_path_buf() }
    }
}
