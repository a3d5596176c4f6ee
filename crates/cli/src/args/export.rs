//! Arguments of `roadplane export`.

use std::path::PathBuf;

use clap::Args;

/// `roadplane export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Folder of the finished run, DIR/<stem>.
    #[arg(value_name = "RUN")]
    pub run: Option<PathBuf>,
    /// Formats, separated by commas; `list` says what there is and what each holds.
    #[arg(long, value_name = "F", value_delimiter = ',', required = true)]
    pub format: Vec<String>,
    /// Each format gets a folder FOLDER/<format>/, complete or not there at all.
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub site: super::site::SiteArgs,
    /// Replaces finished folders (once the new one is complete).
    #[arg(long)]
    pub overwrite: bool,
}
