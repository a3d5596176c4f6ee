//! What can go wrong, by who can mend it. Paths stand last in the messages.

use std::io::Read as _;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use roadplane_pipeline::{Fault, PipelineError};
use roadplane_write::WriteError;
use thiserror::Error;

/// How a gzipped file begins.
const GZIP: [u8; 2] = [0x1f, 0x8b];
/// What is larger was packed to do harm.
const MOST_UNPACKED_BYTES: u64 = 1 << 30;

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
    /// Tables cannot be written, or a result cannot be read back.
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
            Self::Write(_) => Fault::Internal,
        }
    }

    /// Reads a text file, gzipped or not.
    pub(crate) fn read_text(path: &Path) -> Result<String, Self> {
        let unreadable = |source| Self::Unreadable { source, path: path.to_path_buf() };
        let mut bytes = std::fs::read(path).map_err(unreadable)?;
        if bytes.starts_with(&GZIP) {
            let mut unpacked = Vec::new();
            let most = MOST_UNPACKED_BYTES + 1;
            MultiGzDecoder::new(bytes.as_slice())
                .take(most)
                .read_to_end(&mut unpacked)
                .map_err(unreadable)?;
            if unpacked.len() as u64 == most {
                return Err(Self::malformed(path, "holds over 1 GiB once unpacked"));
            }
            bytes = unpacked;
        }
        String::from_utf8(bytes).map_err(|e| Self::malformed(path, e))
    }
}
