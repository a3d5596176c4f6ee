//! What can go wrong, by who is at fault.

use std::path::PathBuf;

use thiserror::Error;

/// An inference error.
#[derive(Debug, Error)]
pub enum InferError {
    /// The model or its card is not what it should be: nothing was run.
    #[error("model refused: {reason}: {}", path.display())]
    ModelRefused {
        /// Why.
        reason: Refusal,
        /// The card or the model.
        path: PathBuf,
    },
    /// ONNX Runtime is not where it is looked for, or cannot be loaded.
    #[error("ONNX Runtime: {what}; run scripts/setup, or set ORT_DYLIB_PATH to libonnxruntime.so")]
    RuntimeMissing {
        /// What was tried and how it failed.
        what: String,
    },
    /// The provider that the configuration asks for cannot be used here.
    #[error("provider {provider} is not available: {what}")]
    ProviderUnavailable {
        /// The provider asked for.
        provider: &'static str,
        /// Why not.
        what: String,
    },
    /// The net returned NaN or infinite numbers for this input; the session stays usable.
    #[error("{model} returned {count} numbers that are not finite in {output}")]
    NonFinite {
        /// Name of the model.
        model: String,
        /// Name of the output.
        output: String,
        /// How many numbers.
        count: usize,
    },
    /// The caller's tensors are not what the card says: a bug.
    #[error("{model} was given wrong tensors: {what}")]
    WrongInput {
        /// Name of the model.
        model: String,
        /// What is wrong.
        what: String,
    },
    /// The runtime failed while it ran a net that it had accepted.
    #[error("{model} failed: {what}")]
    Failed {
        /// Name of the model.
        model: String,
        /// What the runtime says.
        what: String,
    },
}

/// Why a model was refused.
#[derive(Debug, Error)]
pub enum Refusal {
    /// A file cannot be read.
    #[error("cannot be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// The card is not JSON of the documented form.
    #[error("malformed card: {0}")]
    MalformedCard(#[from] serde_json::Error),
    /// The card says something impossible.
    #[error("unsuitable card: {0}")]
    UnsuitableCard(String),
    /// Larger than any model that this program runs.
    #[error("{bytes} bytes are more than the {limit} allowed")]
    TooLarge {
        /// Size of the file.
        bytes: u64,
        /// Largest size allowed.
        limit: u64,
    },
    /// Not the file that the card describes.
    #[error("sha256 is {found}, the card says {expected}")]
    WrongHash {
        /// The card's.
        expected: String,
        /// The file's.
        found: String,
    },
    /// The model refers to data outside its file.
    #[error("tensor {0:?} lies outside the file")]
    ExternalData(String),
    /// Not a protobuf message.
    #[error("not an ONNX file: {0}")]
    NotOnnx(&'static str),
    /// The runtime does not accept it.
    #[error("the runtime says: {0}")]
    Rejected(String),
    /// Inputs or outputs are not the card's.
    #[error("{0}")]
    Interface(String),
}
