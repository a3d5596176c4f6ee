//! Facts about a run: size and hash of the input, versions of the program and its libraries, and peak memory.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use roadplane_write::InputSummary;
use sha2::{Digest as _, Sha256};

use crate::PipelineError;
use crate::config::hex;

/// Returns the name for the result of an input. It is the input's file name without extension, or the name of the
/// input's folder.
#[must_use]
pub fn stem_of(input: &Path) -> String {
    let absolute = std::path::absolute(input).unwrap_or_else(|_unresolvable| input.to_path_buf());
    let name = if absolute.is_dir() { absolute.file_name() } else { absolute.file_stem() };
    name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Returns the path, the size and the sha256 of an input. The files of a folder count as one long file, in the order of
/// their names.
///
/// # Errors
/// Returns [`PipelineError::Unreadable`] if a file or folder cannot be read.
pub fn file_identity(input: &Path) -> Result<InputSummary, PipelineError> {
    let fail = |path: &Path| {
        let path = path.to_path_buf();
        move |source| PipelineError::Unreadable { source, path }
    };
    let mut files = vec![input.to_path_buf()];
    if input.is_dir() {
        let entries = std::fs::read_dir(input).map_err(fail(input))?;
        files = entries.filter_map(Result::ok).map(|entry| entry.path()).filter(|p| p.is_file()).collect();
        files.sort();
    }
    let mut hash = Sha256::new();
    let mut bytes = 0;
    let mut buffer = vec![0; 1 << 20];
    for path in &files {
        let mut file = File::open(path).map_err(fail(path))?;
        loop {
            let read = file.read(&mut buffer).map_err(fail(path))?;
            if read == 0 {
                break;
            }
            hash.update(&buffer[..read]);
            bytes += read as u64;
        }
    }
    Ok(InputSummary { path: input.display().to_string(), bytes, sha256: hex(&hash.finalize()) })
}

/// Returns the versions of the program and of its libraries, by their names.
#[must_use]
pub fn versions() -> BTreeMap<String, String> {
    let mut versions = BTreeMap::new();
    versions.insert("roadplane".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
    versions.insert("opencv".to_owned(), roadplane_decode::library_version());
    if let Ok(version) = roadplane_infer::runtime_version(None) {
        versions.insert("onnxruntime".to_owned(), version);
    }
    versions
}

/// Returns the peak resident memory of this process so far, bytes; `None` if the system does not report it.
#[must_use]
pub fn peak_memory_bytes() -> Option<u64> {
    crate::limits::status_bytes("VmHWM:")
}
