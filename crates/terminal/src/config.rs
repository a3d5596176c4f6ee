//! The arguments `--config` and `--set`, which set the configuration.

use std::path::PathBuf;

use clap::Args;
use roadplane_pipeline::{Config, PipelineError};

/// Arguments for the configuration: a file with settings, and single settings that override the file.
#[derive(Clone, Debug, Args)]
pub struct ConfigArgs {
    /// TOML file with settings; configs/default.toml documents every setting.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Override one setting, for example --set detect.min_score=0.4 (repeatable).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
}

impl ConfigArgs {
    /// Reads the configuration from the arguments.
    ///
    /// # Errors
    /// [`PipelineError`] for a file that cannot be read, and for a setting that is unknown or out of range.
    pub fn load(&self) -> Result<Config, PipelineError> {
        self.load_with(&[])
    }

    /// Reads the configuration from the arguments. `more` are settings as for `--set`, from other arguments.
    ///
    /// # Errors
    /// [`PipelineError`] in the same cases as for [`Self::load`].
    pub fn load_with(&self, more: &[String]) -> Result<Config, PipelineError> {
        let settings = [self.settings.as_slice(), more].concat();
        Config::load(self.config.as_deref(), &settings).map_err(PipelineError::from)
    }
}
