//! `roadplane-lab bench`: the cost of a run on an input, compared with the cost of decoding alone.

mod measured;
mod table;

use std::path::Path;

use roadplane_pipeline::{
    Cancel, Config, FolderLock, PipelineError, RunOptions, find_models, forget_peak_memory, measure_decoding,
    run_input,
};
use roadplane_write::{Summary, read_summary};

use crate::args::bench::BenchArgs;
use measured::Measured;
use roadplane_terminal::{Bar, Outcome};

/// Runs the input in one or two configurations, measures decoding without a run, and prints the costs.
pub fn bench(args: &BenchArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let mut kept = None;
    let temporary;
    let out = match &args.out {
        Some(folder) => {
            kept = Some(FolderLock::acquire(folder).map_err(PipelineError::from)?);
            folder.as_path()
        }
        None => {
            temporary = tempfile::Builder::new().prefix(".roadplane-bench-").tempdir_in(".")?;
            temporary.path()
        }
    };
    let mut configs = vec![config.clone()];
    if args.full && config.watch.attention {
        let mut full = config.clone();
        full.watch.attention = false;
        configs.push(full);
    }
    let (mut runs, mut damaged) = (Vec::new(), false);
    for config in &configs {
        let (run, summary) = one(&args.input, out, config, cancel)?;
        damaged |= summary.exit_code != 0;
        runs.push(run);
    }
    let decoding = measure_decoding(&args.input, &config, cancel)?;
    drop(kept);
    let name = args.input.display().to_string();
    if args.json {
        table::print_json(&name, &runs, &decoding)?
    } else {
        table::print(&name, &runs, &decoding)?
    }
    Ok(if damaged { Outcome::Damaged } else { Outcome::Done })
}

/// Runs the pipeline on the input once and measures the cost.
fn one(input: &Path, out: &Path, config: &Config, cancel: &Cancel) -> anyhow::Result<(Measured, Summary)> {
    let name = if config.watch.attention { "attention" } else { "full" };
    let models = find_models(config.models.folder.as_deref())?;
    let options = RunOptions { alone: true, ..RunOptions::new(models) };
    if !forget_peak_memory() {
        tracing::debug!("the peak memory is that of all runs so far");
    }
    let report = run_input(input, &out.join(name), &options, config, cancel, &Bar::new(name))?;
    let summary = read_summary(&report.folder.join("summary.json")).map_err(PipelineError::from)?;
    let speed = summary.speed.clone().unwrap_or_default();
    Ok((Measured { name, speed, peak_memory_bytes: summary.peak_memory_bytes }, summary))
}
