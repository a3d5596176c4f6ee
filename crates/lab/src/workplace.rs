//! A folder for the files that runs write: a temporary folder, or a folder that the user names.

use std::path::{Path, PathBuf};

use roadplane_write::WriteError;

use crate::LabError;

/// A folder for the files that runs write. A temporary folder is deleted when this value is dropped.
pub(crate) struct Workplace {
    folder: PathBuf,
    /// The guard that deletes a temporary folder when it is dropped; `None` for a folder that the user names.
    _temporary: Option<tempfile::TempDir>,
}

impl Workplace {
    /// Makes the folder `keep`, or a temporary folder if `keep` is `None`.
    pub fn new(keep: Option<&Path>) -> Result<Self, LabError> {
        if let Some(keep) = keep {
            std::fs::create_dir_all(keep).map_err(|source| no_folder(source, keep))?;
            return Ok(Self { folder: keep.to_path_buf(), _temporary: None });
        }
        let temporary = tempfile::tempdir().map_err(|source| no_folder(source, Path::new("temporary")))?;
        Ok(Self { folder: temporary.path().to_path_buf(), _temporary: Some(temporary) })
    }

    /// Returns the path of the folder.
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
    fn only_a_temporary_folder_is_removed() {
        let here = tempfile::tempdir().unwrap();
        let kept = here.path().join("kept");
        drop(Workplace::new(Some(&kept)).unwrap());
        assert!(kept.is_dir());
        let workplace = Workplace::new(None).unwrap();
        let folder = workplace.folder().to_path_buf();
        assert!(folder.is_dir());
        drop(workplace);
        assert!(!folder.exists());
    }
}
