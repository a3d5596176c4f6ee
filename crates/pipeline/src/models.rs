//! Where the models are.

use std::path::{Path, PathBuf};

use crate::PipelineError;

/// A file that every models folder has.
const LANDMARK: &str = "keypoints.json";

/// The folder with the models: as configured, else `ROADPLANE_MODELS`, else that of the Python package that came with the
/// executable, else `models/` beside the executable, in a folder above it, or in the current one.
///
/// # Errors
/// [`PipelineError::ModelsMissing`] that says where was looked.
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

/// The library of the ONNX runtime.
///
/// # Errors
/// [`PipelineError::Infer`] that says where was looked.
pub fn find_runtime() -> Result<PathBuf, PipelineError> {
    Ok(roadplane_infer::find_library(None)?)
}
