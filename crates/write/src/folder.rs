//! The folder of one result. It is filled under a temporary name, then renamed in one step.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use crate::WriteError;
use crate::file::{is_temp, sync_folder};

/// The action to take if a result of the same name already exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Keep the existing result and fail.
    Refuse,
    /// Replace the existing result when the new result is complete.
    Overwrite,
}

/// A result folder in progress. It is named `DIR/.<stem>.partial/` until it is complete, and `DIR/<stem>/` afterwards.
///
/// After an error, or if the process is killed, the partial folder remains. A later run can resume from it.
#[derive(Debug)]
pub struct OutputFolder {
    dir: PathBuf,
    partial: PathBuf,
    target: PathBuf,
    aside: PathBuf,
    existing: Existing,
}

impl OutputFolder {
    /// Creates the partial folder, or opens the partial folder of an earlier run.
    ///
    /// The caller must have a [`FolderLock`](crate::FolderLock) on `dir`.
    ///
    /// # Errors
    /// [`WriteError::Exists`] if a result exists and `existing` is [`Existing::Refuse`]; [`WriteError::BadStem`],
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn begin(dir: &Path, stem: &str, existing: Existing) -> Result<Self, WriteError> {
        if stem.is_empty() || stem.starts_with('.') || stem.contains(['/', '\0']) {
            return Err(WriteError::BadStem { stem: stem.to_owned() });
        }
        let target = dir.join(stem);
        let partial = dir.join(format!(".{stem}.partial"));
        let aside = dir.join(format!(".{stem}.old"));
        fs::create_dir_all(dir).map_err(WriteError::io("create the folder", dir))?;
        settle(&target, &aside)?;
        if existing == Existing::Refuse && target.exists() {
            return Err(WriteError::Exists { path: target });
        }
        fs::create_dir_all(&partial).map_err(WriteError::io("create the folder", &partial))?;
        Ok(Self { dir: dir.to_path_buf(), partial, target, aside, existing })
    }

    /// Writes a result in one go. `write` gets the path of the empty partial folder. After an error, nothing remains.
    ///
    /// The caller must have a [`FolderLock`](crate::FolderLock) on `dir`.
    ///
    /// # Errors
    /// The error of `write`, or those of [`OutputFolder::begin`] and [`OutputFolder::publish`].
    pub fn write<E: From<WriteError>>(
        dir: &Path,
        stem: &str,
        existing: Existing,
        write: impl FnOnce(&Path) -> Result<(), E>,
    ) -> Result<PathBuf, E> {
        let folder = Self::begin(dir, stem, existing)?;
        folder.clear(&[])?;
        match write(folder.path()) {
            Ok(()) => Ok(folder.publish()?),
            Err(error) => {
                folder.discard()?;
                Err(error)
            }
        }
    }

    /// Returns the path of the partial folder. The caller writes all files there before [`OutputFolder::publish`].
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// Removes everything from the partial folder but the files that are named in `kept`.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn clear(&self, kept: &[&str]) -> Result<(), WriteError> {
        let doing = |path: &Path| WriteError::io("empty the folder", path);
        for entry in fs::read_dir(&self.partial).map_err(doing(&self.partial))? {
            let entry = entry.map_err(doing(&self.partial))?;
            let path = entry.path();
            if kept.iter().any(|name| entry.file_name() == **name) {
                continue;
            }
            let is_folder = entry.file_type().map_err(doing(&path))?.is_dir();
            let removed = if is_folder { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            removed.map_err(doing(&path))?;
        }
        Ok(())
    }

    /// Removes the partial folder after a failed run. It is meant for failures from which no later run can resume.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn discard(self) -> Result<(), WriteError> {
        fs::remove_dir_all(&self.partial).map_err(WriteError::io("remove", &self.partial))
    }

    /// Syncs every file to disk, renames the folder to its final name, and returns its final path.
    ///
    /// An older result is first renamed to `DIR/.<stem>.old/` and removed at the end. So a complete result, old or new,
    /// is on disk at all times.
    ///
    /// # Errors
    /// [`WriteError::Exists`], [`WriteError::Io`], [`WriteError::DiskFull`]. After an error, the partial folder
    /// remains.
    pub fn publish(self) -> Result<PathBuf, WriteError> {
        sync_tree(&self.partial)?;
        match fs::rename(&self.target, &self.aside) {
            Ok(()) if self.existing == Existing::Refuse => {
                fs::rename(&self.aside, &self.target).map_err(WriteError::io("restore", &self.target))?;
                return Err(WriteError::Exists { path: self.target });
            }
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(WriteError::io("move the old result aside", &self.target)(error)),
        }
        fs::rename(&self.partial, &self.target).map_err(WriteError::io("rename to", &self.target))?;
        sync_folder(&self.dir)?;
        settle(&self.target, &self.aside)?;
        Ok(self.target)
    }
}

/// Completes the replacement of a result if a kill interrupted it.
///
/// If the new result `target` exists, the old result `aside` is removed. Otherwise `aside` is renamed back to `target`.
fn settle(target: &Path, aside: &Path) -> Result<(), WriteError> {
    if !aside.exists() {
        return Ok(());
    }
    if target.exists() {
        fs::remove_dir_all(aside).map_err(WriteError::io("remove the old result", aside))
    } else {
        fs::rename(aside, target).map_err(WriteError::io("restore", target))
    }
}

/// Syncs `folder` and everything in it to disk, and removes temporary files.
fn sync_tree(folder: &Path) -> Result<(), WriteError> {
    let doing = |path: &Path| WriteError::io("sync", path);
    for entry in fs::read_dir(folder).map_err(doing(folder))? {
        let entry = entry.map_err(doing(folder))?;
        let path = entry.path();
        if entry.file_type().map_err(doing(&path))?.is_dir() {
            sync_tree(&path)?;
        } else if entry.file_name().to_str().is_some_and(is_temp) {
            fs::remove_file(&path).map_err(WriteError::io("remove", &path))?;
        } else {
            File::open(&path).and_then(|f| f.sync_all()).map_err(doing(&path))?;
        }
    }
    sync_folder(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &OutputFolder, text: &str) {
        fs::write(folder.path().join("summary.json"), text).unwrap();
    }

    fn read(dir: &Path) -> String {
        fs::read_to_string(dir.join("clip/summary.json")).unwrap()
    }

    #[test]
    fn a_result_is_complete_or_absent() {
        let temp = tempfile::tempdir().unwrap();
        let dir = temp.path().join("out");
        let folder = OutputFolder::begin(&dir, "clip", Existing::Refuse).unwrap();
        write(&folder, "1");
        fs::write(folder.path().join(".tracks.csv.tmp"), "unfinished").unwrap();
        assert!(!dir.join("clip").exists());
        assert_eq!(folder.publish().unwrap(), dir.join("clip"));
        assert_eq!(read(&dir), "1");
        let names: Vec<_> = fs::read_dir(&dir).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(names, ["clip"]);
        assert_eq!(fs::read_dir(dir.join("clip")).unwrap().count(), 1, "unfinished files are not published");
    }

    #[test]
    fn the_old_result_stays_until_the_new_one_is_complete() {
        let temp = tempfile::tempdir().unwrap();
        let begin = |existing| OutputFolder::begin(temp.path(), "clip", existing);
        let folder = begin(Existing::Refuse).unwrap();
        write(&folder, "old");
        folder.publish().unwrap();
        assert!(matches!(begin(Existing::Refuse), Err(WriteError::Exists { .. })));
        let folder = begin(Existing::Overwrite).unwrap();
        write(&folder, "new");
        assert_eq!(read(temp.path()), "old");
        drop(folder);
        let folder = begin(Existing::Overwrite).unwrap();
        assert!(folder.path().join("summary.json").exists());
        folder.publish().unwrap();
        assert_eq!(read(temp.path()), "new");
        assert_eq!(fs::read_dir(temp.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_result_that_appears_during_the_run_is_not_replaced() {
        let temp = tempfile::tempdir().unwrap();
        let folder = OutputFolder::begin(temp.path(), "clip", Existing::Refuse).unwrap();
        write(&folder, "new");
        fs::create_dir(temp.path().join("clip")).unwrap();
        fs::write(temp.path().join("clip/summary.json"), "other").unwrap();
        assert!(matches!(folder.publish(), Err(WriteError::Exists { .. })));
        assert_eq!(read(temp.path()), "other");
    }

    #[test]
    fn a_kill_between_the_two_renames_loses_nothing() {
        let temp = tempfile::tempdir().unwrap();
        fs::create_dir(temp.path().join(".clip.old")).unwrap();
        fs::write(temp.path().join(".clip.old/summary.json"), "old").unwrap();
        let folder = OutputFolder::begin(temp.path(), "clip", Existing::Overwrite).unwrap();
        assert_eq!(read(temp.path()), "old");
        write(&folder, "new");
        fs::create_dir(folder.path().join("traffic")).unwrap();
        fs::write(folder.path().join("frames.jsonl"), "{}").unwrap();
        folder.clear(&["frames.jsonl"]).unwrap();
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left, ["frames.jsonl"]);
    }

    #[test]
    fn invalid_names_are_rejected() {
        let temp = tempfile::tempdir().unwrap();
        for stem in ["", ".", "..", ".hidden", "a/b"] {
            assert!(matches!(
                OutputFolder::begin(temp.path(), stem, Existing::Refuse),
                Err(WriteError::BadStem { .. })
            ));
        }
    }
}
