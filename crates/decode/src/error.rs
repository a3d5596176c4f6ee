//! Errors that concern an input as a whole. Partial damage is listed in the report instead.

use std::path::PathBuf;

use thiserror::Error;

/// The reason why an input cannot be used.
#[derive(Debug, Error)]
pub enum DecodeError {
    /// The input does not exist or may not be read.
    #[error("cannot be read: {source}: {}", path.display())]
    Unreadable {
        /// The operating system's error.
        source: std::io::Error,
        /// The input.
        path: PathBuf,
    },
    /// The input is the address of a stream, and not a file.
    #[error(
        "streams are not read; record them: {address}\nThis command cuts the stream into clips of ten minutes, named \
         by camera and time:\n  ffmpeg {transport}-i '{address}' -an -c copy -f segment -segment_time 600 \
         -reset_timestamps 1 -strftime 1 'clips/CAMERA_%Y%m%d_%H%M%S.mp4'"
    )]
    Stream {
        /// The address, without a password.
        address: String,
        /// Options of ffmpeg for the transport.
        transport: &'static str,
    },
    /// The content is not of a kind that this crate decodes. The file's name does not matter.
    #[error("not a video or an image: {what}: {}", path.display())]
    NotMedia {
        /// The reason why the content is rejected.
        what: String,
        /// The input.
        path: PathBuf,
    },
    /// The input is media, but no frame can be decoded.
    #[error("damaged: {what}: {}", path.display())]
    Damaged {
        /// A description of the damage.
        what: String,
        /// The input.
        path: PathBuf,
    },
    /// The input is larger than the configuration allows.
    #[error("over the limit: {what}: {}", path.display())]
    OverLimit {
        /// The limit that is exceeded.
        what: String,
        /// The input.
        path: PathBuf,
    },
    /// An option has an impossible value. The configuration must be corrected.
    #[error("{what}")]
    Option {
        /// A description of the fault.
        what: String,
    },
    /// The decoding library failed in a way that does not depend on the input.
    #[error("OpenCV: {what}")]
    Library {
        /// OpenCV's message.
        what: String,
    },
}
