//! The configuration of a command.

use roadplane_pipeline::{Config, PipelineError};

use crate::args::config::ConfigArgs;

/// The configuration that the arguments ask for.
pub fn config(args: &ConfigArgs) -> Result<Config, PipelineError> {
    Config::load(args.config.as_deref(), &args.settings).map_err(PipelineError::from)
}
