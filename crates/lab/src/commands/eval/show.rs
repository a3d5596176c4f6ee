//! Prints and writes the report of an evaluation.

use std::io::Write as _;
use std::path::Path;

use crate::LabError;
use roadplane_tables::Report;

/// Prints a report's tables, and writes them with the plots if a folder is given.
pub fn show(report: &Report, out: Option<&Path>) -> anyhow::Result<()> {
    if let Some(folder) = out {
        report.write(folder).map_err(LabError::from)?;
    }
    Ok(std::io::stdout().lock().write_all(report.to_text().as_bytes())?)
}
