//! Finds the folder of the models and the library of ONNX Runtime.

use std::path::{Path, PathBuf};

use crate::PipelineError;

/// Name of a file that every models folder contains. The search recognises the folder by this file.
const LANDMARK: &str = "keypoints.json";

/// Returns the folder that contains the models.
///
/// The configured folder is used if there is one, or else the folder in the environment variable `ROADPLANE_MODELS`. If
/// neither is set, these folders are searched in order:
/// - the folder of the Python package, if `pip` installed the executable,
/// - `models/` beside the executable or in a folder above the executable,
/// - `models/` in the current folder.
///
/// # Errors
/// Returns [`PipelineError::ModelsMissing`], which names the searched folders, if no folder contains models.
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

/// Returns the path of the library of ONNX Runtime.
///
/// # Errors
/// Returns [`PipelineError::Infer`], which names the searched places, if the library is not found.
pub fn find_runtime() -> Result<PathBuf, PipelineError> {
    Ok(roadplane_infer::find_library(None)?)
}
