//! What can go wrong, by who can mend it. Paths stand last in the messages.

use std::path::{Path, PathBuf};

use roadplane_pipeline::{Fault, PipelineError};
use roadplane_tables::TableError;
use roadplane_write::WriteError;
use thiserror::Error;

/// Why something cannot be evaluated.
#[derive(Debug, Error)]
pub enum EvalError {
    /// A file cannot be read.
    #[error("cannot be read: {source}: {}", path.display())]
    Unreadable {
        /// The system's answer.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// A file is not of its documented form.
    #[error("{what}: {}", path.display())]
    Malformed {
        /// The field or line, and what is wrong with it.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// Files that do not belong together, or too little to say anything.
    #[error("{what}")]
    Unsuitable {
        /// What, and what to do.
        what: String,
    },
    /// A net or a run of the pipeline failed.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A report cannot be made or written.
    #[error(transparent)]
    Tables(#[from] TableError),
    /// A folder cannot be made, or a result cannot be read back.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl EvalError {
    /// A file that is not of its documented form.
    #[must_use]
    pub fn malformed(path: &Path, what: impl ToString) -> Self {
        Self::Malformed { what: what.to_string(), path: path.to_path_buf() }
    }

    /// Who can mend it.
    #[must_use]
    pub fn fault(&self) -> Fault {
        match self {
            Self::Unreadable { .. } | Self::Malformed { .. } => Fault::Input,
            Self::Unsuitable { .. } => Fault::Usage,
            Self::Pipeline(error) => error.fault(),
            Self::Write(WriteError::Malformed { .. }) => Fault::Input,
            Self::Tables(_) | Self::Write(_) => Fault::Internal,
        }
    }
}
