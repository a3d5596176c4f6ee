//! `roadplane-lab eval dataset`: all systems on a data set, as in the tables of the paper *Car Pose in Context*.

use crate::{DatasetOptions, evaluate_dataset};
use roadplane_pipeline::{Cancel, find_models};

use crate::args::eval::{EvalDatasetArgs, Keypoints};
use crate::commands::eval::show::show;
use roadplane_terminal::{Bar, Outcome};

/// Prints the tables of a data set.
pub fn dataset(args: &EvalDatasetArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let options = DatasetOptions {
        part: args.part,
        net: args.keypoints != Keypoints::Noise,
        noise: (args.keypoints != Keypoints::Net).then_some(args.noise),
        stride: args.stride,
        real: args.real.clone(),
        models: find_models(config.models.folder.as_deref())?,
        runs: args.out.as_ref().map(|out| out.join("runs")),
    };
    let report = evaluate_dataset(&args.folder, &options, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
