//! A lock that allows one run at a time in a folder.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;

use crate::WriteError;

/// Name of the lock file.
const LOCK_NAME: &str = ".roadplane.lock";

/// A lock on an output folder, released when dropped.
///
/// The operating system holds the lock and releases it when the process ends, even by a kill. So the lock file may
/// stay.
#[derive(Debug)]
pub struct FolderLock {
    // Closing the file releases the lock.
    _file: File,
}

impl FolderLock {
    /// Creates the folder if it does not exist, and locks it.
    ///
    /// # Errors
    /// [`WriteError::Locked`], without waiting, if another run has the lock; [`WriteError::Io`] if the folder cannot be
    /// used.
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
