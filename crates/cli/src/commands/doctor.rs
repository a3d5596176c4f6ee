//! `roadplane doctor`: checks everything that a run needs.

use std::io::Write as _;

use roadplane_pipeline::{PipelineError, check_up};

use crate::args::DoctorArgs;
use roadplane_terminal::Outcome;

/// Prints one line per check. Returns the error of the first check that fails.
pub fn doctor(args: &DoctorArgs) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let mut out = std::io::stdout().lock();
    let mut first_failure: Option<PipelineError> = None;
    for check in check_up(&config) {
        match check.result {
            Ok(text) => writeln!(out, "ok    {:<18} {text}", check.name)?,
            Err(error) => {
                writeln!(out, "FAIL  {:<18} {error}", check.name)?;
                first_failure = first_failure.or(Some(error));
            }
        }
    }
    first_failure.map_or(Ok(Outcome::Done), |error| Err(error.into()))
}
