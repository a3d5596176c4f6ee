//! Errors of inference, sorted by their cause.

use std::path::PathBuf;

use thiserror::Error;

/// An inference error.
#[derive(Debug, Error)]
pub enum InferError {
    /// The model or its card does not pass the checks. The model was not run.
    #[error("model refused: {reason}: {}", path.display())]
    ModelRefused {
        /// The reason for the refusal.
        reason: Refusal,
        /// The path of the card or the model.
        path: PathBuf,
    },
    /// ONNX Runtime was not found, or cannot be loaded.
    #[error("ONNX Runtime: {what}; run scripts/setup, or set ORT_DYLIB_PATH to libonnxruntime.so")]
    RuntimeMissing {
        /// Description of the failed attempts.
        what: String,
    },
    /// The configured execution provider cannot be used on this machine.
    #[error("provider {provider} is not available: {what}")]
    ProviderUnavailable {
        /// The configured provider.
        provider: &'static str,
        /// Reason why ONNX Runtime cannot use the execution provider.
        what: String,
    },
    /// The net returned NaN or infinite numbers for this input. The session stays usable.
    #[error("{model} returned {count} numbers that are not finite in {output}")]
    NonFinite {
        /// Name of the model.
        model: String,
        /// Name of the output.
        output: String,
        /// Number of values that are NaN or infinite.
        count: usize,
    },
    /// The caller's tensors do not agree with the card. This is a bug in the caller.
    #[error("{model} was given wrong tensors: {what}")]
    WrongInput {
        /// Name of the model.
        model: String,
        /// Description of the disagreement.
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
    /// A file is larger than the size limit for models or cards.
    #[error("{bytes} bytes are more than the {limit} allowed")]
    TooLarge {
        /// Number of bytes that were read. Reading stops one byte above the limit.
        bytes: u64,
        /// Largest allowed size, bytes.
        limit: u64,
    },
    /// The hash of the file differs from the hash in the card.
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
    /// The inputs or outputs of the model do not agree with the card.
    #[error("{0}")]
    Interface(String),
}
