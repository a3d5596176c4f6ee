//! One file per command. Each command calls the crate `pipeline` with its arguments and prints the outcome.

pub mod cameras;
pub mod copy;
pub mod distance;
pub mod doctor;
pub mod export;
pub mod lab;
pub mod pieces;
pub mod render;
pub mod run;
pub mod schemas;
pub mod site;
pub mod stages;
pub mod traffic;

use std::path::{Path, PathBuf};

use roadplane_pipeline::PipelineError;

/// Splits the output folder into its parent and its name.
pub fn split(out: &Path) -> Result<(PathBuf, String), PipelineError> {
    let name = out.file_name().and_then(|name| name.to_str());
    let name = name.ok_or_else(|| PipelineError::usage("--out must name a folder"))?;
    let parent = out.parent().filter(|parent| !parent.as_os_str().is_empty());
    Ok((parent.unwrap_or_else(|| Path::new(".")).to_path_buf(), name.to_owned()))
}
