//! The options of the evaluation of a data set, and the items of the data set.

use std::path::{Path, PathBuf};

use crate::LabError;
use roadplane_metrics::truth::{Truth, read_truth, scene_name};

/// Largest number of frames of a clip that the systems for single frames solve.
///
/// The cars of a clip change little from frame to frame, and stills should have more weight than clips.
pub(super) const FRAMES_OF_CLIP: usize = 5;

/// Options of the evaluation of a data set.
#[derive(Clone, Debug)]
pub struct DatasetOptions {
    /// Share of the items to evaluate; 0.1 means every tenth item.
    pub part: f64,
    /// Whether to evaluate the systems on keypoints that our net predicts in the true boxes.
    pub net: bool,
    /// sd of the noise on true keypoints, as a share of the longer side of the box; `None` if true keypoints are not
    /// used.
    pub noise: Option<f64>,
    /// Every n-th frame of a clip is processed; this is n.
    pub stride: u32,
    /// Folder of real stills with calibrated cameras beside them (`NAME.png` or `.jpg`, `NAME.krtd`).
    pub real: Option<PathBuf>,
    /// Folder of the nets' files.
    pub models: PathBuf,
    /// Folder for the finished runs of clips; `None` for a temporary folder.
    ///
    /// Several runs work at the same time, one per core. Their `summary.json` therefore does not show the speed of a
    /// single run.
    pub runs: Option<PathBuf>,
}

/// An item of a data set with its truth.
pub(super) struct Item {
    pub name: String,
    pub path: PathBuf,
    pub truth: Truth,
}

/// Reads a truth file as an item of a data set.
pub(super) fn item(path: &Path) -> Result<Item, LabError> {
    Ok(Item { name: scene_name(path), path: path.to_path_buf(), truth: read_truth(path)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_named_by_their_truth_files() {
        for file in ["clip_0001.truth.json.gz", "clip_0001.truth.json", "clip_0001"] {
            assert_eq!(scene_name(&Path::new("scenes").join(file)), "clip_0001");
        }
    }
}
