//! Errors of the detector.

use roadplane_infer::InferError;
use thiserror::Error;

/// A detection error.
#[derive(Debug, Error)]
pub enum DetectError {
    /// The net failed, or returned numbers that are not finite.
    #[error(transparent)]
    Net(#[from] InferError),
    /// The net's card does not describe a detector that this code can read.
    #[error("{model} is not a detector: {what}")]
    UnsuitableNet {
        /// The net's name.
        model: String,
        /// The input, output or class that is missing or different.
        what: String,
    },
    /// An OpenCV call failed on the picture: a bug, or no memory left.
    #[error("OpenCV: {what}")]
    Picture {
        /// OpenCV's message.
        what: String,
    },
    /// An option is out of its range: a fault of the configuration.
    #[error("detect.{what}")]
    Option {
        /// The option, and its allowed values.
        what: String,
    },
}

impl DetectError {
    pub(crate) fn picture(error: opencv::Error) -> Self {
        Self::Picture { what: error.to_string() }
    }

    /// Returns the net's own error, if it is one.
    #[must_use]
    pub fn net(&self) -> Option<&InferError> {
        match self {
            Self::Net(error) => Some(error),
            _ => None,
        }
    }
}
