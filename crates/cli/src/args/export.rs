//! Arguments of `roadplane export`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `roadplane export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Folder of the finished run, DIR/<name>.
    #[arg(value_name = "RUN")]
    pub run: Option<PathBuf>,
    /// Formats, separated by commas; `list` lists the formats and their contents; `all` writes every format whose data
    /// the run has.
    #[arg(long, value_name = "F", value_delimiter = ',', required = true)]
    pub format: Vec<String>,
    /// Output folder; each format gets FOLDER/<format>/, which appears only when it is complete.
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub site: super::site::SiteArgs,
    /// Replace finished folders once the new ones are complete.
    #[arg(long)]
    pub overwrite: bool,
}
