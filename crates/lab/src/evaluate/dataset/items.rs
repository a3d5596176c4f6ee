//! The options of the evaluation of a data set, and its items.

use std::path::{Path, PathBuf};

use roadplane_pipeline::{Cancel, PipelineError};

use crate::LabError;
use roadplane_metrics::truth::{Truth, read_truth};

/// Most frames of a clip that the systems for single frames solve. A clip's cars stay much the same, and stills should
/// have the greater weight.
pub(super) const FRAMES_OF_CLIP: usize = 5;

/// Options of the evaluation of a data set.
#[derive(Clone, Debug)]
pub struct DatasetOptions {
    /// Share of the items; 0.1 takes every tenth.
    pub part: f64,
    /// Whether to use the keypoints of our net, in the true boxes.
    pub net: bool,
    /// Whether to use true keypoints, and the sd of their noise as a share of the box's longer side.
    pub noise: Option<f64>,
    /// Process every n-th frame of a clip.
    pub stride: u32,
    /// Folder of real stills with calibrated cameras beside them (`NAME.png` or `.jpg`, `NAME.krtd`).
    pub real: Option<PathBuf>,
    /// Folder of the models.
    pub models: PathBuf,
    /// Folder that keeps the finished runs of clips; `None` for a temporary folder. As many runs work at once as there
    /// are cores, so their `summary.json` does not show the speed of a run alone.
    pub runs: Option<PathBuf>,
}

/// An item of a data set with its truth.
pub(super) struct Item {
    pub name: String,
    pub path: PathBuf,
    pub truth: Truth,
}

/// Reads the item of a truth file.
pub(super) fn item(path: &Path) -> Result<Item, LabError> {
    Ok(Item { name: item_name(path), path: path.to_path_buf(), truth: read_truth(path)? })
}

/// Returns the name of an item: `clip_0000` for `scenes/clip_0000.truth.json.gz`.
pub(super) fn item_name(truth: &Path) -> String {
    let name = truth.file_name().unwrap_or(truth.as_os_str()).to_string_lossy();
    let plain = name.strip_suffix(".gz").unwrap_or(&name);
    plain.strip_suffix(".truth.json").unwrap_or(plain).to_owned()
}

/// Returns an error if the user stopped the work.
pub(super) fn stopped(cancel: &Cancel) -> Result<(), LabError> {
    cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_named_by_their_truth_files() {
        for file in ["clip_0001.truth.json.gz", "clip_0001.truth.json", "clip_0001"] {
            assert_eq!(item_name(&Path::new("scenes").join(file)), "clip_0001");
        }
    }
}
