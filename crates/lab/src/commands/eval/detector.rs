//! `roadplane-lab eval detector`: the detection net on pictures with true boxes.

use roadplane_infer::ProviderChoice;
use roadplane_pipeline::{Cancel, find_models};
use roadplane_terminal::{Bar, Outcome};

use crate::args::eval::{EvalDetectorArgs, NumberFormat};
use crate::commands::eval::show::show;
use crate::{DetectorOptions, evaluate_detector};

/// Prints the tables, and draws the worst pictures if a folder is given.
pub fn detector(args: &EvalDetectorArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let models = find_models(config.models.folder.as_deref())?;
    let format = |format: &NumberFormat| match format {
        NumberFormat::F32 => ("f32", ProviderChoice::Cpu),
        NumberFormat::Int8 => ("int8", ProviderChoice::Int8),
        NumberFormat::Bf16 => ("bf16", ProviderChoice::Openvino),
    };
    let options = DetectorOptions {
        formats: args.format.iter().map(format).collect(),
        min_width_px: args.min_width_px.unwrap_or(config.detect.min_width_px),
        worst: if args.out.is_some() { args.worst as usize } else { 0 },
    };
    let report = evaluate_detector(&args.inputs, &models, &config, &options, cancel, &Bar::new("eval"))?;
    show(&report, args.out.as_deref())?;
    Ok(Outcome::Done)
}
