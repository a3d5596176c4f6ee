//! A file that is either complete or absent. It is written under a temporary name, synced, then renamed.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::WriteError;

/// Size of the write buffer, bytes.
const BUFFER_BYTES: usize = 1 << 18;

/// A file in progress. It gets its final name in [`OutFile::finish`]. If this value is dropped earlier, the temporary
/// file is removed.
#[derive(Debug)]
pub struct OutFile {
    // `None` after `finish`.
    writer: Option<BufWriter<File>>,
    temp: PathBuf,
    path: PathBuf,
}

impl OutFile {
    /// Starts a file with the final name `path`. A temporary file that a killed run left is replaced.
    ///
    /// # Errors
    /// [`WriteError::Io`] or [`WriteError::DiskFull`].
    pub fn create(path: &Path) -> Result<Self, WriteError> {
        let temp = temp_of(path)?;
        match std::fs::remove_file(&temp) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(WriteError::io("replace a leftover file", &temp)(error));
            }
            _ => {}
        }
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&temp)
            .map_err(WriteError::io("create a file", path))?;
        Ok(Self::over(file, temp, path.to_path_buf()))
    }

    fn over(file: File, temp: PathBuf, path: PathBuf) -> Self {
        Self { writer: Some(BufWriter::with_capacity(BUFFER_BYTES, file)), temp, path }
    }

    /// Returns the final path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// [`WriteError::Io`] or [`WriteError::DiskFull`].
    pub fn write_bytes(&mut self, bytes: &[u8]) -> Result<(), WriteError> {
        self.write_all(bytes).map_err(WriteError::io("write", &self.path))
    }

    /// Completes the file: writes all bytes to disk, renames the file and syncs its folder.
    ///
    /// # Errors
    /// [`WriteError::Io`] or [`WriteError::DiskFull`]. After an error, no file with the final name appears.
    pub fn finish(mut self) -> Result<(), WriteError> {
        if let Some(writer) = self.writer.as_mut() {
            writer.flush().map_err(WriteError::io("write", &self.path))?;
            writer.get_ref().sync_all().map_err(WriteError::io("write", &self.path))?;
        }
        std::fs::rename(&self.temp, &self.path).map_err(WriteError::io("rename to", &self.path))?;
        self.writer = None;
        sync_folder(parent_of(&self.path))
    }
}

impl Write for OutFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer.as_mut().map_or(Err(io::ErrorKind::BrokenPipe.into()), |writer| writer.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.as_mut().map_or(Ok(()), Write::flush)
    }
}

impl Drop for OutFile {
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            // The buffer is not flushed, because the file is removed.
            drop(writer.into_parts());
            std::fs::remove_file(&self.temp).ok();
        }
    }
}

/// Returns the temporary path of a file: `.NAME.tmp` in the same folder.
///
/// A final path always has the same temporary path. So repeated kills leave at most one temporary file.
fn temp_of(path: &Path) -> Result<PathBuf, WriteError> {
    let name = path.file_name().ok_or_else(|| WriteError::Io {
        doing: "create a file",
        source: io::ErrorKind::InvalidInput.into(),
        path: path.to_path_buf(),
    })?;
    let mut temp = std::ffi::OsString::from(".");
    temp.push(name);
    temp.push(".tmp");
    Ok(path.with_file_name(temp))
}

/// Whether a file name has the form of the temporary names that [`OutFile`] uses.
pub(crate) fn is_temp(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".tmp")
}

/// Returns the folder that contains a path; `.` for a bare file name.
pub(crate) fn parent_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."))
}

/// Syncs a folder to disk. Afterwards the names of its files survive a crash.
pub(crate) fn sync_folder(folder: &Path) -> Result<(), WriteError> {
    File::open(folder).and_then(|f| f.sync_all()).map_err(WriteError::io("sync the folder", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_appears_only_when_finished() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let mut file = OutFile::create(&path).unwrap();
        file.write_bytes(b"one").unwrap();
        assert!(!path.exists());
        drop(file);
        assert!(names(folder.path()).is_empty(), "a dropped file leaves nothing");
        std::fs::write(folder.path().join(".a.json.tmp"), b"left by a killed run").unwrap();
        let mut file = OutFile::create(&path).unwrap();
        file.write_bytes(b"two").unwrap();
        file.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(names(folder.path()), ["a.json"]);
    }

    #[test]
    fn a_full_disk_is_named_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let temp = folder.path().join(".a.json.tmp");
        std::os::unix::fs::symlink("/dev/full", &temp).unwrap();
        let full = OpenOptions::new().write(true).open(&temp).unwrap();
        let mut file = OutFile::over(full, temp, path.clone());
        file.write_bytes(b"fits into the buffer").unwrap();
        let error = file.finish().unwrap_err();
        assert!(matches!(&error, WriteError::DiskFull { path: p } if *p == path));
        assert!(error.to_string().ends_with("a.json"), "{error}");
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_missing_folder_is_an_error_that_ends_with_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let error = OutFile::create(&folder.path().join("none/a.json")).unwrap_err();
        assert!(matches!(error, WriteError::Io { .. }));
        assert!(error.to_string().ends_with("none/a.json"), "{error}");
    }
}
