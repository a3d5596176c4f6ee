//! The camera database (`--cameras`): the evidence of other clips of the same camera.
//!
//! Every clip of a command starts from the database as it was when the command began. So neither the number of parallel
//! clips nor interruptions change the result. The evidence of each clip is part of its result (`evidence.json`) and is
//! added to the database when the command ends.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::ImageFormat;
use image::codecs::png::PngEncoder;
use regex::Regex;
use roadplane_base::{CameraEstimate, CameraEvidence, ClipIdentity, ImageSize};
use roadplane_calibrate::{Epoch, SameView, epochs, fuse};
use roadplane_view::ViewError;
use roadplane_watch::{BackgroundPicture, EmptyScene};
use roadplane_write::{EvidenceStore, InputSummary, WriteError, is_camera_id};

use crate::cameras::joining::fuse_options;
use crate::recorded::{Recorded, RecordedFrom};
use crate::{CameraConstraints, Config, PipelineError, stem_of};

/// File name of a clip's evidence in its result.
pub(crate) const EVIDENCE: &str = "evidence.json";
/// Largest displacement of two pictures of the same camera position, as a share of the width. A camera of 60° detects a
/// turn of 0.2°.
const SAME_POSITION: f64 = 0.003;

/// The cameras of a command's inputs.
#[derive(Clone, Debug)]
pub struct CameraDatabase {
    store: EvidenceStore,
    /// Rule that assigns a camera to an input.
    id: CameraId,
    /// Stored evidence, by camera.
    stored: BTreeMap<String, Vec<CameraEvidence>>,
}

/// A rule that assigns a camera to an input.
///
/// It is a name, or a pattern of file names in which `{}` is the name and `*` matches any text.
#[derive(Clone, Debug)]
pub(crate) struct CameraId {
    /// The rule as the user wrote it.
    text: String,
    /// The compiled pattern; `None` for a plain name.
    pattern: Option<Regex>,
}

impl CameraId {
    /// Parses the rule; a usage error if it is not valid.
    pub(crate) fn new(text: &str) -> Result<Self, PipelineError> {
        if !text.contains("{}") {
            return if is_camera_id(text) {
                Ok(Self { text: text.to_owned(), pattern: None })
            } else {
                Err(PipelineError::usage(&format!("--camera-id {text:?} is no valid name of a camera")))
            };
        }
        let form = regex::escape(text).replace(r"\{\}", "(.+?)").replace(r"\*", ".*?");
        let pattern = Regex::new(&format!("^(?s:{form})$"))
            .ok()
            .filter(|pattern| pattern.captures_len() == 2)
            .ok_or_else(|| {
                PipelineError::usage(&format!(
                    "--camera-id {text:?}: a pattern must contain {{}} exactly once"
                ))
            })?;
        Ok(Self { text: text.to_owned(), pattern: Some(pattern) })
    }

    /// Returns the camera of an input; `None` if the pattern finds no valid name of a camera in the input's name.
    pub(crate) fn of(&self, input: &Path) -> Option<String> {
        let Some(pattern) = &self.pattern else { return Some(self.text.clone()) };
        let id = pattern.captures(&stem_of(input))?.get(1)?.as_str().to_owned();
        Some(id).filter(|id| is_camera_id(id))
    }
}

impl CameraDatabase {
    /// Reads the stored evidence of the inputs' cameras. Damaged files and inputs without a camera are reported in the
    /// log and skipped.
    ///
    /// # Errors
    /// [`PipelineError::Usage`] where `id` is not valid, [`PipelineError::Write`] where the folder cannot be read.
    pub fn open(folder: &Path, id: &str, inputs: &[impl AsRef<Path>]) -> Result<Self, PipelineError> {
        let (store, id) = (EvidenceStore::new(folder), CameraId::new(id)?);
        let mut stored = BTreeMap::new();
        for input in inputs {
            let Some(camera) = id.of(input.as_ref()) else {
                tracing::warn!("{}", unknown_camera(&id, input.as_ref()));
                continue;
            };
            if let Entry::Vacant(unread) = stored.entry(camera) {
                let evidence = sound(store.read(unread.key())?);
                unread.insert(evidence);
            }
        }
        Ok(Self { store, id, stored })
    }

    /// Returns the camera of an input; `None` if the input's name does not contain a camera.
    #[must_use]
    pub fn camera_of(&self, input: &Path) -> Option<String> {
        self.id.of(input)
    }

    /// Returns the warning about an input without a camera; `None` if the input has a camera.
    pub(crate) fn warning_of(&self, input: &Path) -> Option<String> {
        self.id.of(input).is_none().then(|| unknown_camera(&self.id, input))
    }

    /// Returns the evidence that an input starts from: that of all other clips of its camera. `None` if the input has
    /// no camera.
    pub(crate) fn history_of(
        &self,
        input: &InputSummary,
        recorded: &Recorded,
        models: Vec<String>,
        scene: Option<&EmptyScene>,
    ) -> Result<Option<CameraHistory>, PipelineError> {
        let path = Path::new(&input.path);
        let Some(camera) = self.id.of(path) else { return Ok(None) };
        let name = stem_of(path);
        let Recorded { time, from } = recorded;
        match from {
            RecordedFrom::File => tracing::warn!(
                "{name} is dated {time}, when its file was last changed: neither its name nor its container has a time"
            ),
            from => tracing::info!("{name} was recorded on {time}, according to its {}", from.in_words()),
        }
        let clip = ClipIdentity { recorded: time.clone(), sha256: input.sha256.clone(), name };
        let stored = self.stored.get(&camera).map(Vec::as_slice).unwrap_or_default();
        let evidence = stored.iter().filter(|e| e.clip.sha256 != clip.sha256).cloned().collect();
        let place = scene.map(|scene| packed(&BackgroundPicture::of(&scene.picture)?)).transpose()?;
        Ok(Some(CameraHistory { camera, clip, models, place, evidence }))
    }

    /// Adds the evidence of a finished result to the database, if it has any.
    ///
    /// # Errors
    /// [`PipelineError::Write`] where a file cannot be read or written.
    pub fn learn(&self, result: &Path) -> Result<(), PipelineError> {
        let path = result.join(EVIDENCE);
        if path.is_file() && self.store.add(&path)? {
            tracing::debug!("added to the camera database: {}", path.display());
        }
        Ok(())
    }
}

fn unknown_camera(id: &CameraId, input: &Path) -> String {
    format!(
        "the pattern --camera-id {:?} finds no camera in the name {:?}: this clip does not use the camera database",
        id.text,
        stem_of(input)
    )
}

/// Drops evidence that cannot be read, and reports it in the log.
pub(crate) fn sound(read: Vec<Result<CameraEvidence, WriteError>>) -> Vec<CameraEvidence> {
    let report = |error: &WriteError| tracing::error!("a file of the camera database is skipped: {error}");
    read.into_iter().filter_map(|evidence| evidence.inspect_err(report).ok()).collect()
}

/// The stored evidence that a clip starts from, and the clip's identity.
#[derive(Clone, Debug)]
pub(crate) struct CameraHistory {
    /// Name of the camera.
    pub camera: String,
    /// Identity of the clip.
    pub clip: ClipIdentity,
    /// Names and sha256 of the nets that found the vehicles and keypoints.
    pub models: Vec<String>,
    /// Picture of the empty scene, as a PNG in base64.
    pub place: Option<String>,
    /// Evidence of all other clips of the camera.
    pub evidence: Vec<CameraEvidence>,
}

/// Compares the pictures of the empty scene of two clips.
pub(crate) fn compare_views(a: &CameraEvidence, b: &CameraEvidence) -> SameView {
    let displacement = || {
        let (a, b) = (unpacked(a.place.as_ref()?)?, unpacked(b.place.as_ref()?)?);
        a.displacement(&b)
    };
    match displacement() {
        Some(off) if off.share <= SAME_POSITION => SameView::Same,
        Some(off) if off.share - off.error > SAME_POSITION => SameView::Moved,
        _ => SameView::Unknown,
    }
}

/// Encodes a picture of the scene as a PNG in base64.
fn packed(place: &BackgroundPicture) -> Result<String, PipelineError> {
    let mut png = Vec::new();
    place.to_grey().write_with_encoder(PngEncoder::new(&mut png)).map_err(ViewError::from)?;
    Ok(STANDARD.encode(png))
}

/// Decodes a picture of the scene from base64.
///
/// `None` for text that is no picture, or a large one: files from elsewhere are not trusted.
fn unpacked(text: &str) -> Option<BackgroundPicture> {
    let mut reader = image::ImageReader::new(std::io::Cursor::new(STANDARD.decode(text).ok()?));
    reader.set_format(ImageFormat::Png);
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(1024), Some(1024));
    reader.limits(limits);
    Some(BackgroundPicture::from_grey(&reader.decode().ok()?.into_luma8()))
}

/// A stored camera over one epoch.
#[derive(Clone, Debug)]
pub struct StoredCamera {
    /// Identities of the clips, in order.
    pub clips: Vec<ClipIdentity>,
    /// Estimate of the camera; its sds include the uncertainty of the cars' size.
    pub estimate: CameraEstimate,
}

/// Returns the epochs of a stored camera, in order, each with its estimate.
///
/// # Errors
/// [`PipelineError::Write`] where the folder cannot be read.
pub fn stored_cameras(
    store: &EvidenceStore,
    camera: &str,
    config: &Config,
) -> Result<Vec<StoredCamera>, PipelineError> {
    let evidence = sound(store.read(camera)?);
    let size = |epoch: &Epoch<'_>| epoch.clips.first().map(|clip| clip.image_size_px);
    let any = evidence.first().map_or(ImageSize { width: 1, height: 1 }, |first| first.image_size_px);
    let epochs = epochs(
        &evidence,
        &compare_views,
        &fuse_options(any, 1, &CameraConstraints::default(), config).for_cars(),
    );
    let known = |epoch: &Epoch<'_>| {
        let options = fuse_options(size(epoch)?, 1, &CameraConstraints::default(), config);
        let estimate = fuse(&epoch.windows, &options).pop()?;
        Some(StoredCamera { clips: epoch.clips.iter().map(|e| e.clip.clone()).collect(), estimate })
    };
    Ok(epochs.iter().filter_map(known).collect())
}

/// Joins several camera databases, and output folders of runs, into one. Returns the number of new clips.
///
/// # Errors
/// [`PipelineError::Write`]. A damaged file stops the command, because its evidence would be missing.
pub fn merge_cameras(from: &[PathBuf], out: &Path) -> Result<usize, PipelineError> {
    let out = EvidenceStore::new(out);
    let mut added = 0;
    for folder in from {
        for camera in EvidenceStore::new(folder).cameras()? {
            // A folder of a run has the name of a clip and contains its result.
            let result = folder.join(&camera).join(EVIDENCE);
            let files = if result.is_file() {
                vec![result]
            } else if folder.join(&camera).join("summary.json").is_file() {
                Vec::new()
            } else {
                EvidenceStore::new(folder).files(&camera)?
            };
            for file in files {
                added += usize::from(out.add(&file)?);
            }
        }
    }
    Ok(added)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_named_or_found_in_the_files_name() {
        let of = |id: &str, file: &str| CameraId::new(id).unwrap().of(Path::new(file));
        assert_eq!(of("gate-3", "a.mp4").unwrap(), "gate-3");
        assert_eq!(of("{}_*", "/x/gate-3_20260131_2200.mp4").unwrap(), "gate-3");
        assert_eq!(of("VIRAT_S_{}_*", "VIRAT_S_0401_02.mp4").unwrap(), "0401");
        assert_eq!(of("*.{}", "2026.c1.mp4").unwrap(), "c1");
        assert_eq!((of("{}_*", "plain.mp4"), of("{}_*", "._a.mp4")), (None, None));
        for id in ["", "a/b", "..", "{}_{}"] {
            assert!(matches!(CameraId::new(id), Err(PipelineError::Usage { .. })), "{id}");
        }
    }

    #[test]
    fn an_input_without_a_camera_does_not_use_the_database() {
        let folder = tempfile::tempdir().unwrap();
        let inputs = ["gate_20260131.mp4", "plain.mp4"].map(PathBuf::from);
        let database = CameraDatabase::open(folder.path(), "{}_*", &inputs).unwrap();
        let history = |input: &Path| {
            let input = InputSummary { path: input.display().to_string(), ..InputSummary::default() };
            let recorded = Recorded { time: "2026-01-31T00:00:00".to_owned(), from: RecordedFrom::Name };
            database.history_of(&input, &recorded, Vec::new(), None).unwrap()
        };
        assert_eq!(history(&inputs[0]).unwrap().camera, "gate");
        assert!(history(&inputs[1]).is_none() && database.warning_of(&inputs[0]).is_none());
        assert!(database.warning_of(&inputs[1]).unwrap().contains("finds no camera in the name \"plain\""));
    }
}
