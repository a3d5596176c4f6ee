//! What can go wrong.

use roadplane_infer::InferError;
use thiserror::Error;

/// A detection error.
#[derive(Debug, Error)]
pub enum DetectError {
    /// The net failed, or returned numbers that are not finite.
    #[error(transparent)]
    Net(#[from] InferError),
    /// The net's card does not describe a detector that this code can read.
    #[error("{model} is no detector: {what}")]
    UnsuitableNet {
        /// The net's name.
        model: String,
        /// What is missing.
        what: String,
    },
    /// OpenCV cannot resample the picture: a bug, or no memory left.
    #[error("OpenCV: {what}")]
    Picture {
        /// What it says.
        what: String,
    },
    /// An option out of its range: a fault of the configuration.
    #[error("detect.{what}")]
    Option {
        /// Which, and what is allowed.
        what: String,
    },
}

impl DetectError {
    pub(crate) fn picture(error: opencv::Error) -> Self {
        Self::Picture { what: error.to_string() }
    }

    /// The net's own error, if it is one.
    #[must_use]
    pub fn net(&self) -> Option<&InferError> {
        match self {
            Self::Net(error) => Some(error),
            _ => None,
        }
    }
}
