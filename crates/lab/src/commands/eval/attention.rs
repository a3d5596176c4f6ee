//! `roadplane eval attention`: with attention against without.

use roadplane_lab::evaluate_attention;
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::EvalAttentionArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::Bar;
use roadplane_terminal::Outcome;

/// Prints the table.
pub fn attention(args: &EvalAttentionArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let temporary = tempfile::tempdir()?;
    let work = args.out.as_ref().map_or_else(|| temporary.path().to_path_buf(), |out| out.join("runs"));
    let report = evaluate_attention(&args.clips, &models, &work, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
