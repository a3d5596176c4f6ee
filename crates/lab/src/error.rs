//! Errors of the laboratory. Each error has a kind of fault: usage, input or internal. A message ends with the path of
//! the file.

use std::path::Path;

use roadplane_metrics::MetricsError;
use roadplane_pipeline::{Fault, PipelineError};
use roadplane_tables::TableError;
use roadplane_write::WriteError;
use thiserror::Error;

/// The reason why an evaluation fails.
#[derive(Debug, Error)]
pub enum LabError {
    /// A truth file, or a file of another program, cannot be read or compared.
    #[error(transparent)]
    Metrics(#[from] MetricsError),
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

impl LabError {
    /// Returns the error for a file whose content is not in its documented format. `what` describes the mistake.
    #[must_use]
    pub fn malformed(path: &Path, what: impl ToString) -> Self {
        MetricsError::malformed(path, what).into()
    }

    /// Returns the error for files that do not belong together, or that contain too little data to compare.
    #[must_use]
    pub fn unsuitable(what: impl ToString) -> Self {
        MetricsError::Unsuitable { what: what.to_string() }.into()
    }

    /// Returns the kind of fault, which decides the exit code: usage, input or internal.
    #[must_use]
    pub fn fault(&self) -> Fault {
        match self {
            Self::Metrics(error) => Self::fault_of_metrics(error),
            Self::Write(WriteError::Malformed { .. }) => Fault::Input,
            Self::Pipeline(error) => error.fault(),
            Self::Tables(_) | Self::Write(_) => Fault::Internal,
        }
    }

    /// Returns the kind of fault of an error from the crate `metrics`: usage or input.
    #[must_use]
    pub fn fault_of_metrics(error: &MetricsError) -> Fault {
        match error {
            MetricsError::Unsuitable { .. } => Fault::Usage,
            MetricsError::Unreadable { .. } | MetricsError::Malformed { .. } => Fault::Input,
        }
    }
}
