//! `roadplane-lab eval kitti`: systems on the KITTI benchmark, as in Table 3 of the paper *Car Pose in Context*.

use crate::{KittiOptions, evaluate_kitti};
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::EvalKittiArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::{Bar, Outcome};

/// Prints the tables of scores on KITTI's images.
pub fn kitti(args: &EvalKittiArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let options = KittiOptions { part: args.part, models };
    let report = evaluate_kitti(&args.folder, &options, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
