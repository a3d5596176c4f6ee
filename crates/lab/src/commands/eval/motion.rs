//! `roadplane-lab eval motion`: runs on clips of moving cameras.

use roadplane_pipeline::{Cancel, find_models};
use roadplane_terminal::{Bar, Outcome};

use crate::args::eval::EvalMotionArgs;
use crate::commands::eval::show::show;
use crate::workplace::Workplace;
use crate::{MotionOptions, evaluate_motion};

/// Prints the tables that compare moving cameras with cameras at rest.
pub fn motion(args: &EvalMotionArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let options = MotionOptions {
        models: find_models(config.models.folder.as_deref())?,
        seconds: args.seconds,
        focal_px: args.focal_px,
        is_focal_given: args.given_focal,
        mirrored: args.mirrored,
        motions: args.motions.clone(),
        distortion: args.distortion,
    };
    let work = Workplace::new(args.out.as_deref())?;
    let report = evaluate_motion(&args.inputs, work.folder(), &options, &config, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
