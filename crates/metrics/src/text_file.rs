//! Reads text files, gzipped or not.

use std::io::Read as _;
use std::path::Path;

use flate2::read::MultiGzDecoder;

use crate::MetricsError;

/// The first bytes of a gzipped file.
const GZIP: [u8; 2] = [0x1f, 0x8b];
/// Largest unpacked size, bytes. Larger files are rejected, because they may be compression bombs.
const MOST_UNPACKED_BYTES: u64 = 1 << 30;

/// Reads a text file. A gzipped file is unpacked first.
///
/// # Errors
/// [`MetricsError::Unreadable`]; [`MetricsError::Malformed`] for a file that cannot be unpacked, exceeds 1 GiB when
/// unpacked, or is no UTF-8 text.
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
