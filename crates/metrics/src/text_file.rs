//! Text files, gzipped or not.

use std::io::Read as _;
use std::path::Path;

use flate2::read::MultiGzDecoder;

use crate::MetricsError;

/// How a gzipped file begins.
const GZIP: [u8; 2] = [0x1f, 0x8b];
/// What is larger was packed to do harm.
const MOST_UNPACKED_BYTES: u64 = 1 << 30;

/// Reads a text file and unpacks it where it is gzipped.
///
/// # Errors
/// [`MetricsError::Unreadable`]; [`MetricsError::Malformed`] where it is torn, too large once unpacked, or no text.
pub fn read_text(path: &Path) -> Result<String, MetricsError> {
    let mut bytes = std::fs::read(path)
        .map_err(|source| MetricsError::Unreadable { source, path: path.to_path_buf() })?;
    if bytes.starts_with(&GZIP) {
        let mut unpacked = Vec::new();
        let most = MOST_UNPACKED_BYTES + 1;
        MultiGzDecoder::new(bytes.as_slice())
            .take(most)
            .read_to_end(&mut unpacked)
            .map_err(|e| MetricsError::malformed(path, format!("cannot be unpacked: {e}")))?;
        if unpacked.len() as u64 == most {
            return Err(MetricsError::malformed(path, "holds over 1 GiB once unpacked"));
        }
        bytes = unpacked;
    }
    String::from_utf8(bytes).map_err(|e| MetricsError::malformed(path, e))
}
