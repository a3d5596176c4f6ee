//! Finds the models and the library of the ONNX runtime.

use std::path::{Path, PathBuf};

use crate::PipelineError;

/// A file that every folder of models has.
const LANDMARK: &str = "keypoints.json";

/// Returns the folder with the models.
///
/// A configured folder or `ROADPLANE_MODELS` decides, in this order. Otherwise these are searched:
/// - the folder of the Python package of the executable,
/// - `models/` beside the executable or in a folder above it,
/// - `models/` in the current folder.
///
/// # Errors
/// [`PipelineError::ModelsMissing`] with the folders that were searched.
pub fn find_models(configured: Option<&Path>) -> Result<PathBuf, PipelineError> {
    let has_models = |folder: &Path| folder.join(LANDMARK).is_file();
    let named =
        configured.map(Path::to_path_buf).or_else(|| std::env::var_os("ROADPLANE_MODELS").map(PathBuf::from));
    if let Some(folder) = named {
        return if has_models(&folder) {
            Ok(folder)
        } else {
            Err(PipelineError::ModelsMissing { tried: folder.display().to_string() })
        };
    }
    let executable = std::env::current_exe().ok();
    let above = executable.iter().flat_map(|exe| exe.ancestors().skip(1));
    let packages = executable.iter().flat_map(|exe| roadplane_infer::python_packages(exe));
    packages
        .map(|folder| folder.join("roadplane/models"))
        .chain(above.map(|folder| folder.join("models")))
        .chain([PathBuf::from("models")])
        .find(|folder| has_models(folder))
        .ok_or_else(|| PipelineError::ModelsMissing {
            tried: "models/ beside the executable, above it, and in the current folder".to_owned(),
        })
}

/// Returns the library of the ONNX runtime.
///
/// # Errors
/// [`PipelineError::Infer`] with the folders that were searched.
pub fn find_runtime() -> Result<PathBuf, PipelineError> {
    Ok(roadplane_infer::find_library(None)?)
}
