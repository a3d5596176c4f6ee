//! `roadplane-lab eval regions`: compares runs with and without region-of-interest scheduling.

use crate::evaluate_regions;
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::EvalRegionsArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::{Bar, Outcome};

/// Prints the tables that compare the two runs of each clip.
pub fn regions(args: &EvalRegionsArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let temporary = tempfile::tempdir()?;
    let work = args.out.as_ref().map_or_else(|| temporary.path().to_path_buf(), |out| out.join("runs"));
    let report = evaluate_regions(&args.clips, &models, &work, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
