//! What can go wrong with an input as a whole; partial damage is told in the report instead.

use std::path::PathBuf;

use thiserror::Error;

/// Why an input cannot be used.
#[derive(Debug, Error)]
pub enum DecodeError {
    /// It does not exist or may not be read.
    #[error("cannot be read: {source}: {}", path.display())]
    Unreadable {
        /// Why.
        source: std::io::Error,
        /// The input.
        path: PathBuf,
    },
    /// Its content is nothing that is decoded here, whatever its name says.
    #[error("no video or image: {what}: {}", path.display())]
    NotMedia {
        /// What it is instead.
        what: String,
        /// The input.
        path: PathBuf,
    },
    /// It is media, but nothing can be decoded.
    #[error("damaged: {what}: {}", path.display())]
    Damaged {
        /// What is known.
        what: String,
        /// The input.
        path: PathBuf,
    },
    /// Larger than the configuration allows.
    #[error("over the limit: {what}: {}", path.display())]
    OverLimit {
        /// Which limit.
        what: String,
        /// The input.
        path: PathBuf,
    },
    /// An option that makes no sense: a fault of the configuration.
    #[error("{what}")]
    Option {
        /// What is wrong.
        what: String,
    },
    /// The decoding library fails in a way that does not depend on the input.
    #[error("OpenCV: {what}")]
    Library {
        /// What it says.
        what: String,
    },
}
