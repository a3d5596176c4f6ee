//! Where files of runs lie while they are needed, or for good.

use std::path::{Path, PathBuf};

use roadplane_write::WriteError;

use crate::LabError;

/// A folder.
pub(crate) struct Workplace {
    folder: PathBuf,
    /// Removes the folder at the end.
    _temporary: Option<tempfile::TempDir>,
}

impl Workplace {
    /// In `keep`, else somewhere for the time being.
    pub fn new(keep: Option<&Path>) -> Result<Self, LabError> {
        if let Some(keep) = keep {
            std::fs::create_dir_all(keep).map_err(|source| no_folder(source, keep))?;
            return Ok(Self { folder: keep.to_path_buf(), _temporary: None });
        }
        let temporary = tempfile::tempdir().map_err(|source| no_folder(source, Path::new("temporary")))?;
        Ok(Self { folder: temporary.path().to_path_buf(), _temporary: Some(temporary) })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

fn no_folder(source: std::io::Error, path: &Path) -> LabError {
    LabError::from(WriteError::Io { doing: "make the folder", source, path: path.to_path_buf() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_folder_that_nobody_asked_for_vanishes() {
        let here = tempfile::tempdir().unwrap();
        let kept = here.path().join("kept");
        drop(Workplace::new(Some(&kept)).unwrap());
        assert!(kept.is_dir());
        let place = Workplace::new(None).unwrap();
        let folder = place.folder().to_path_buf();
        assert!(folder.is_dir());
        drop(place);
        assert!(!folder.exists());
    }
}
