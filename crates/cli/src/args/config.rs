//! Arguments of the configuration.

use std::path::PathBuf;

use clap::Args;

/// Where configuration comes from.
#[derive(Clone, Debug, Args)]
pub struct ConfigArgs {
    /// TOML file; configs/default.toml documents every field.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Overrides one field, e.g. --set detect.min_score=0.4 (repeatable).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
}
