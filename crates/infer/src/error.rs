//! Errors of inference, by who is at fault.

use std::path::PathBuf;

use thiserror::Error;

/// An inference error.
#[derive(Debug, Error)]
pub enum InferError {
    /// The model or its card does not pass the checks; nothing was run.
    #[error("model refused: {reason}: {}", path.display())]
    ModelRefused {
        /// The reason for the refusal.
        reason: Refusal,
        /// The path of the card or the model.
        path: PathBuf,
    },
    /// ONNX Runtime is not in the searched places, or cannot be loaded.
    #[error("ONNX Runtime: {what}; run scripts/setup, or set ORT_DYLIB_PATH to libonnxruntime.so")]
    RuntimeMissing {
        /// The attempts and their failures.
        what: String,
    },
    /// The configured provider cannot be used here.
    #[error("provider {provider} is not available: {what}")]
    ProviderUnavailable {
        /// The configured provider.
        provider: &'static str,
        /// The reason.
        what: String,
    },
    /// The net returned NaN or infinite numbers for this input; the session stays usable.
    #[error("{model} returned {count} numbers that are not finite in {output}")]
    NonFinite {
        /// Name of the model.
        model: String,
        /// Name of the output.
        output: String,
        /// The number of non-finite values.
        count: usize,
    },
    /// The caller's tensors do not fit the card: a bug.
    #[error("{model} was given wrong tensors: {what}")]
    WrongInput {
        /// Name of the model.
        model: String,
        /// A description of the mismatch.
        what: String,
    },
    /// The runtime failed while it ran a net that it had accepted.
    #[error("{model} failed: {what}")]
    Failed {
        /// Name of the model.
        model: String,
        /// The runtime's message.
        what: String,
    },
}

/// The reason why a model was refused.
#[derive(Debug, Error)]
pub enum Refusal {
    /// A file cannot be read.
    #[error("cannot be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// The card is not JSON of the documented form.
    #[error("malformed card: {0}")]
    MalformedCard(#[from] serde_json::Error),
    /// The card contains an impossible value.
    #[error("unsuitable card: {0}")]
    UnsuitableCard(String),
    /// A file is larger than any model that this program runs.
    #[error("{bytes} bytes are more than the {limit} allowed")]
    TooLarge {
        /// Size of the file.
        bytes: u64,
        /// Largest size allowed.
        limit: u64,
    },
    /// The file's hash differs from the card's.
    #[error("sha256 is {found}, the card says {expected}")]
    WrongHash {
        /// The hash in the card.
        expected: String,
        /// The hash of the file.
        found: String,
    },
    /// The model refers to data outside its file.
    #[error("tensor {0:?} lies outside the file")]
    ExternalData(String),
    /// The file is not a protobuf message.
    #[error("not an ONNX file: {0}")]
    NotOnnx(&'static str),
    /// The runtime rejected the model.
    #[error("the runtime says: {0}")]
    Rejected(String),
    /// The model's inputs or outputs differ from the card's.
    #[error("{0}")]
    Interface(String),
}
