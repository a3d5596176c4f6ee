//! The camera database on disk. Each clip has one file, `FOLDER/<camera>/<clip>.<content>.json`.
//!
//! In a file name, `<content>` is the first digits of the sha256 of the file's content. So a file never changes, and
//! adding the same file twice has no further effect. To merge two databases, the files of both are copied into one
//! folder, in any order.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use roadplane_base::CameraEvidence;
use sha2::{Digest as _, Sha256};

use crate::file::sync_folder;
use crate::{OutFile, WriteError};

/// Number of hexadecimal digits of the sha256 in a file's name.
const DIGITS: usize = 16;
/// Largest length of the clip's name within a file name, bytes. A longer name is cut.
const NAME_BYTES: usize = 100;
/// Largest length of a camera's name, bytes.
const CAMERA_BYTES: usize = 100;

/// A camera database: a folder with one subfolder per stored camera.
#[derive(Clone, Debug)]
pub struct EvidenceStore {
    folder: PathBuf,
}

/// Whether a text is a valid name of a camera. The name is also the name of the camera's folder in the database.
#[must_use]
pub fn is_camera_id(id: &str) -> bool {
    let sound = |c: char| c.is_alphanumeric() || "-_.+@ ".contains(c);
    !id.is_empty()
        && id.len() <= CAMERA_BYTES
        && !id.starts_with('.')
        && id.trim() == id
        && id.chars().all(sound)
}

/// Reads an evidence file. It contains the camera parameters from one clip, with their uncertainties.
///
/// # Errors
/// [`WriteError::Malformed`] if the file is not a valid evidence file; [`WriteError::Io`].
pub fn read_evidence(path: &Path) -> Result<CameraEvidence, WriteError> {
    parsed(path, &fs::read(path).map_err(WriteError::io("read", path))?)
}

fn parsed(path: &Path, bytes: &[u8]) -> Result<CameraEvidence, WriteError> {
    let evidence: CameraEvidence =
        serde_json::from_slice(bytes).map_err(|e| WriteError::malformed(path, e))?;
    checked(path, &evidence)?;
    Ok(evidence)
}

fn checked(path: &Path, evidence: &CameraEvidence) -> Result<(), WriteError> {
    evidence.check().map_err(|e| WriteError::malformed(path, e))?;
    if is_camera_id(&evidence.camera) {
        return Ok(());
    }
    Err(WriteError::malformed(path, format!("{:?} is not a valid name of a camera", evidence.camera)))
}

/// Writes an evidence file. It contains the camera parameters from one clip, with their uncertainties.
///
/// # Errors
/// [`WriteError::Malformed`], [`WriteError::Io`], [`WriteError::DiskFull`].
pub fn write_evidence(path: &Path, evidence: &CameraEvidence) -> Result<(), WriteError> {
    checked(path, evidence)?;
    let mut bytes = serde_json::to_vec(evidence).map_err(|e| WriteError::malformed(path, e))?;
    bytes.push(b'\n');
    let mut file = OutFile::create(path)?;
    file.write_bytes(&bytes)?;
    file.finish()
}

fn file_name(evidence: &CameraEvidence, bytes: &[u8]) -> String {
    let digits: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    let mut name = String::new();
    for c in evidence.clip.name.chars().map(|c| if c == '/' || c.is_control() { '_' } else { c }) {
        if name.len() + c.len_utf8() > NAME_BYTES {
            break;
        }
        name.push(c);
    }
    format!("{}.{}.json", name.trim_start_matches('.'), &digits[..DIGITS])
}

impl EvidenceStore {
    /// Opens a camera database. If the folder does not exist, the database is empty.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_path_buf() }
    }

    /// Returns the folder of the database.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the names of the stored cameras, sorted.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn cameras(&self) -> Result<Vec<String>, WriteError> {
        let names = sorted_names(&self.folder)?;
        Ok(names.into_iter().filter(|id| is_camera_id(id) && self.folder.join(id).is_dir()).collect())
    }

    /// Returns the paths of a camera's evidence files, sorted by name. The list is empty if the camera is not in the
    /// database.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn files(&self, camera: &str) -> Result<Vec<PathBuf>, WriteError> {
        let folder = self.folder.join(camera);
        let names = sorted_names(&folder)?.into_iter();
        Ok(names.filter(|n| n.ends_with(".json") && !n.starts_with('.')).map(|n| folder.join(n)).collect())
    }

    /// Reads all evidence files of a camera, in the order of their names.
    ///
    /// The list is empty if the camera is not in the database. For a damaged file, the list contains an error.
    ///
    /// # Errors
    /// [`WriteError::Io`] if the folder cannot be read.
    pub fn read(&self, camera: &str) -> Result<Vec<Result<CameraEvidence, WriteError>>, WriteError> {
        let read = |path: PathBuf| {
            let evidence = read_evidence(&path)?;
            if evidence.camera != camera {
                return Err(WriteError::malformed(
                    &path,
                    format!("it belongs to camera {:?}", evidence.camera),
                ));
            }
            Ok(evidence)
        };
        Ok(self.files(camera)?.into_iter().map(read).collect())
    }

    /// Copies an evidence file into the database without changes. Returns false if the database already contains the
    /// file.
    ///
    /// # Errors
    /// [`WriteError::Malformed`], [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn add(&self, file: &Path) -> Result<bool, WriteError> {
        let bytes = fs::read(file).map_err(WriteError::io("read", file))?;
        let evidence = parsed(file, &bytes)?;
        let folder = self.folder.join(&evidence.camera);
        let path = folder.join(file_name(&evidence, &bytes));
        if path.exists() {
            return Ok(false);
        }
        fs::create_dir_all(&folder).map_err(WriteError::io("create the folder", &folder))?;
        let mut file = OutFile::create(&path)?;
        file.write_bytes(&bytes)?;
        file.finish()?;
        sync_folder(&self.folder)?;
        Ok(true)
    }

    /// Removes a camera with all its evidence files. Returns false if the camera is not in the database.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn forget(&self, camera: &str) -> Result<bool, WriteError> {
        let folder = self.folder.join(camera);
        if !is_camera_id(camera) || !folder.is_dir() {
            return Ok(false);
        }
        fs::remove_dir_all(&folder).map_err(WriteError::io("remove", &folder))?;
        Ok(true)
    }
}

/// Returns the sorted names of the files and folders in a folder. The list is empty if the folder does not exist.
fn sorted_names(folder: &Path) -> Result<Vec<String>, WriteError> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(WriteError::io("read the folder", folder))?,
    };
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry.map_err(WriteError::io("read the folder", folder))?;
        names.extend(entry.file_name().into_string().ok());
    }
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{ClipIdentity, EVIDENCE_SCHEMA, ImageSize};

    fn evidence(camera: &str, clip: &str) -> CameraEvidence {
        CameraEvidence {
            schema: EVIDENCE_SCHEMA.to_owned(),
            camera: camera.to_owned(),
            clip: ClipIdentity {
                recorded: "2026-01-31T22:00:00".to_owned(),
                sha256: format!("{clip}{clip}"),
                name: clip.to_owned(),
            },
            models: vec!["detector abc".to_owned()],
            image_size_px: ImageSize { width: 1920, height: 1080 },
            span_s: [0.0, 60.0],
            frames: 1500,
            params: [7.2, 0.1 + 0.2, 0.0, 2.0],
            information: std::array::from_fn(|r| {
                std::array::from_fn(|c| if r == c { 100.0 / 3.0 } else { 0.0 })
            }),
            shared: [[0.0; roadplane_base::SHARED_ERRORS]; 4],
            lens: None,
            parked: Vec::new(),
            moving: 3,
            place: None,
        }
    }

    /// Writes evidence to a file, as a run does, and adds the file to the database.
    fn add(store: &EvidenceStore, evidence: &CameraEvidence) -> Result<bool, WriteError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("evidence.json");
        write_evidence(&file, evidence)?;
        store.add(&file)
    }

    fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
        let store = EvidenceStore::new(folder);
        let files = store.cameras().unwrap().into_iter().flat_map(|camera| store.files(&camera).unwrap());
        files.map(|f| (f.strip_prefix(folder).unwrap().to_path_buf(), fs::read(f).unwrap())).collect()
    }

    #[test]
    fn a_file_is_stored_once_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let store = EvidenceStore::new(&folder.path().join("cameras"));
        assert!(store.cameras().unwrap().is_empty());
        let first = evidence("gate 3", "a");
        assert!(add(&store, &first).unwrap());
        assert!(!add(&store, &first).unwrap());
        assert!(add(&store, &evidence("gate 3", "b")).unwrap());
        assert!(add(&store, &evidence("yard", "a")).unwrap());
        assert_eq!(store.cameras().unwrap(), ["gate 3", "yard"]);
        let read: Vec<_> = store.read("gate 3").unwrap().into_iter().map(Result::unwrap).collect();
        assert_eq!(read.len(), 2);
        assert_eq!(read[0].clip, first.clip);
        assert!(store.forget("yard").unwrap() && !store.forget("yard").unwrap());
        assert!(!store.forget("..").unwrap());
        assert_eq!(store.cameras().unwrap(), ["gate 3"]);
    }

    #[test]
    fn merging_in_any_order_and_grouping_gives_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: String| folder.path().join(name);
        let clips = 6;
        for clip in 0..clips {
            let camera = if clip % 3 == 0 { "yard" } else { "gate" };
            add(&EvidenceStore::new(&at(format!("one-{clip}"))), &evidence(camera, &format!("clip-{clip}")))
                .unwrap();
        }
        let merge = |from: &[PathBuf], out: &Path| {
            for folder in from {
                let store = EvidenceStore::new(folder);
                for camera in store.cameras().unwrap() {
                    for file in store.files(&camera).unwrap() {
                        EvidenceStore::new(out).add(&file).unwrap();
                    }
                }
            }
        };
        let all: Vec<PathBuf> = (0..clips).map(|clip| at(format!("one-{clip}"))).collect();
        merge(&all, &at("all".to_owned()));
        let expected = contents(&at("all".to_owned()));
        assert_eq!(expected.len(), clips);
        let mut state = 1_u64;
        let mut random = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        for round in 0..100 {
            // Merges two or three folders at a time, until one folder remains. One clip is present twice.
            let mut left = all.clone();
            left.push(all[random(clips)].clone());
            let mut made = 0;
            while left.len() > 1 {
                let count = (2 + random(2)).min(left.len());
                let group: Vec<PathBuf> = (0..count).map(|_| left.swap_remove(random(left.len()))).collect();
                made += 1;
                let out = at(format!("round-{round}-{made}"));
                merge(&group, &out);
                left.push(out);
            }
            assert_eq!(contents(&left[0]), expected, "round {round}");
        }
    }

    #[test]
    fn each_damaged_file_gives_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let store = EvidenceStore::new(folder.path());
        add(&store, &evidence("c", "a")).unwrap();
        fs::write(folder.path().join("c/b.json"), "{").unwrap();
        let mut wrong = evidence("c", "w");
        wrong.params[0] = f64::NAN;
        assert!(matches!(add(&store, &wrong), Err(WriteError::Malformed { .. })));
        let read = store.read("c").unwrap();
        assert_eq!((read.len(), read.iter().filter(|r| r.is_ok()).count()), (2, 1));
    }

    #[test]
    fn invalid_names_of_cameras_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let store = EvidenceStore::new(folder.path());
        for id in ["", ".", "..", "a/b", ".hidden", " a", "a\nb", &"x".repeat(101)] {
            assert!(matches!(add(&store, &evidence(id, "a")), Err(WriteError::Malformed { .. })), "{id:?}");
        }
        assert!(is_camera_id("Tor 3 süd"));
    }
}
