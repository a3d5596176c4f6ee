//! One run at a time in a folder.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;

use crate::WriteError;

/// Name of the lock file.
const LOCK_NAME: &str = ".roadplane.lock";

/// Held while a run writes into a folder. The lock is the operating system's: it ends with its process, however that
/// ends, so a file left behind is no obstacle.
#[derive(Debug)]
pub struct FolderLock {
    // Closing the file gives the lock back.
    _file: File,
}

impl FolderLock {
    /// Makes the folder where it is missing and locks it.
    ///
    /// # Errors
    /// [`WriteError::Locked`] at once where another run holds it, [`WriteError::Io`] where the folder is unusable.
    pub fn acquire(folder: &Path) -> Result<Self, WriteError> {
        std::fs::create_dir_all(folder).map_err(WriteError::io("create the folder", folder))?;
        let path = folder.join(LOCK_NAME);
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&path)
            .map_err(WriteError::io("open the lock", &path))?;
        match file.try_lock() {
            Ok(()) => Ok(Self { _file: file }),
            Err(TryLockError::WouldBlock) => Err(WriteError::Locked { path: folder.to_path_buf() }),
            Err(TryLockError::Error(source)) => Err(WriteError::io("lock the folder", folder)(source)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_is_refused_until_the_first_ends() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new/out");
        let first = FolderLock::acquire(&out).unwrap();
        assert!(matches!(FolderLock::acquire(&out), Err(WriteError::Locked { .. })));
        drop(first);
        assert!(out.join(LOCK_NAME).exists(), "the stale file stays");
        FolderLock::acquire(&out).unwrap();
    }
}
