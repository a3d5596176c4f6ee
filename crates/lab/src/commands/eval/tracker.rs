//! `roadplane-lab eval tracker`: scores tracks from noisy measurements of clips with truth.

use crate::{Noise, TrackerOptions, evaluate_tracker};
use roadplane_pipeline::Cancel;

use crate::args::eval::EvalTrackerArgs;
use crate::commands::eval::show::show;
use roadplane_terminal::{Bar, Outcome};

/// Prints the tables of the tracker's scores.
pub fn tracker(args: &EvalTrackerArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let noise = Noise {
        keypoints: args.noise,
        misses: args.misses,
        false_boxes: args.false_boxes,
        flips: args.flips,
        swaps: args.swaps,
    };
    let options = TrackerOptions {
        recorded: args.recorded.clone(),
        layers: args.layers,
        candidates: args.candidates.clone(),
        joins: args.joins.clone(),
        noise,
        stride: args.stride,
        seed: args.seed,
    };
    let report = evaluate_tracker(&args.clips, &options, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
