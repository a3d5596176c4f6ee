//! Information on the decoding library, for diagnosis.

use opencv::{core, videoio};

/// Returns OpenCV's version.
#[must_use]
pub fn library_version() -> String {
    core::get_version_string().unwrap_or_else(|error| format!("unknown: {error}"))
}

/// Returns the backends with which OpenCV can read video, e.g. `FFMPEG`.
#[must_use]
pub fn backends() -> String {
    let names = videoio::get_backends().map(|backends| {
        backends.iter().filter_map(|api| videoio::get_backend_name(api).ok()).collect::<Vec<_>>().join(", ")
    });
    names.unwrap_or_else(|error| format!("unknown: {error}"))
}
