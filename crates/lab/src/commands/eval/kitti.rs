//! `roadplane eval kitti`: the paper's Table 3.

use roadplane_lab::{KittiOptions, evaluate_kitti};
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::EvalKittiArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::Bar;
use roadplane_terminal::Outcome;

/// Prints the tables.
pub fn kitti(args: &EvalKittiArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let options = KittiOptions { part: args.part, models };
    let report = evaluate_kitti(&args.folder, &options, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
