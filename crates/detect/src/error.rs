//! Errors of the detector.

use roadplane_infer::InferError;
use thiserror::Error;

/// An error of the detector.
#[derive(Debug, Error)]
pub enum DetectError {
    /// The net failed, or returned numbers that are not finite.
    #[error(transparent)]
    Net(#[from] InferError),
    /// The net's model card does not describe a detector that this code can read.
    #[error("{model} is not a detector: {what}")]
    UnsuitableNet {
        /// The net's name.
        model: String,
        /// The input, output or class that is missing or different.
        what: String,
    },
    /// An OpenCV call on the picture failed. The cause is a bug or a lack of memory.
    #[error("OpenCV: {what}")]
    Picture {
        /// OpenCV's message.
        what: String,
    },
    /// An option is out of its range. The configuration must be corrected.
    #[error("detect.{what}")]
    Option {
        /// The name of the option and its allowed values.
        what: String,
    },
}

impl DetectError {
    pub(crate) fn picture(error: opencv::Error) -> Self {
        Self::Picture { what: error.to_string() }
    }

    /// Returns the error of the net, if the net caused this error.
    #[must_use]
    pub fn net(&self) -> Option<&InferError> {
        match self {
            Self::Net(error) => Some(error),
            _ => None,
        }
    }
}
