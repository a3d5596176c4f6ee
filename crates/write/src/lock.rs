//! A lock on a folder. Only one run at a time can have the lock.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;

use crate::WriteError;

/// Name of the lock file.
const LOCK_NAME: &str = ".roadplane.lock";

/// A lock on an output folder. The lock is released when this value is dropped.
///
/// The operating system also releases the lock when the process ends, even if the process is killed. A lock file that
/// remains in the folder does not block later runs.
#[derive(Debug)]
pub struct FolderLock {
    // Closing the file releases the lock.
    _file: File,
}

impl FolderLock {
    /// Creates the folder if it does not exist, and locks it.
    ///
    /// # Errors
    /// [`WriteError::Locked`] if another run has the lock: the function does not wait. [`WriteError::Io`] if the folder
    /// cannot be created or locked.
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
    fn a_second_run_is_rejected_until_the_first_ends() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new/out");
        let first = FolderLock::acquire(&out).unwrap();
        assert!(matches!(FolderLock::acquire(&out), Err(WriteError::Locked { .. })));
        drop(first);
        assert!(out.join(LOCK_NAME).exists(), "the stale file stays");
        FolderLock::acquire(&out).unwrap();
    }
}
