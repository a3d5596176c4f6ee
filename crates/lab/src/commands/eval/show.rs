//! What an evaluation says, printed and written.

use std::io::Write as _;
use std::path::Path;

use roadplane_lab::LabError;
use roadplane_tables::Report;

/// Prints a report's tables; writes them with the plots where a folder is given.
pub fn show(report: &Report, out: Option<&Path>) -> anyhow::Result<()> {
    if let Some(folder) = out {
        report.write(folder).map_err(LabError::from)?;
    }
    Ok(std::io::stdout().lock().write_all(report.to_text().as_bytes())?)
}
