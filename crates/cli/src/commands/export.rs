//! `roadplane export`: writes a finished run in the formats of other tools.

use std::io::{Write as _, stdout};

use roadplane_export::{FORMATS, Format, Run, export as write};
use roadplane_pipeline::{Existing, FolderLock, PipelineError};

use crate::args::export::ExportArgs;
use roadplane_terminal::Outcome;

/// Formats that this program cannot write, each with the tool that writes it.
const ELSEWHERE: [(&str, &str); 1] = [(
    "rerun",
    "recording for the viewer Rerun; scripts/export/rerun RUN FILE.rrd writes it with Rerun's Python package",
)];

/// Writes a run in each requested format.
pub fn export(args: &ExportArgs) -> anyhow::Result<Outcome> {
    if args.format.iter().any(|name| name == "list") {
        let holds = FORMATS.iter().map(|format| (format.name, format.holds));
        for (name, holds) in holds.chain(ELSEWHERE) {
            writeln!(stdout(), "{name:10} {holds}")?;
        }
        return Ok(Outcome::Done);
    }
    let (Some(run), Some(out)) = (&args.run, &args.out) else {
        return Err(PipelineError::usage("export needs the folder of a run and --out FOLDER").into());
    };
    let is_all = args.format.iter().any(|name| name == "all");
    let mut formats: Vec<&Format> = if is_all { FORMATS.iter().collect() } else { Vec::new() };
    for name in args.format.iter().filter(|name| *name != "all") {
        let format = Format::of(name).ok_or_else(|| unknown(name))?;
        if !formats.iter().any(|listed| listed.name == format.name) {
            formats.push(format);
        }
    }
    let mut run = Run::read(run).map_err(PipelineError::from)?;
    if let Some(site) = super::site::site(&args.site)? {
        let fit =
            run.put_on_map(&site).map_err(|what| PipelineError::usage(&format!("on the map: {what}")))?;
        tracing::info!("{fit}");
        for warning in &fit.warnings {
            tracing::warn!("{warning}");
        }
    }
    if is_all {
        formats.retain(|format| is_possible(format, &run));
        for (name, how) in ELSEWHERE {
            tracing::info!("left out: this command cannot write {name}: {how}");
        }
    }
    let _lock = FolderLock::acquire(out).map_err(PipelineError::from)?;
    let existing = if args.overwrite { Existing::Overwrite } else { Existing::Refuse };
    for folder in write(&run, &formats, out, existing).map_err(PipelineError::from)? {
        tracing::info!("{}", folder.display());
    }
    Ok(Outcome::Done)
}

/// Returns whether a run has the data that a format needs. If not, the log gets the reason.
fn is_possible(format: &Format, run: &Run) -> bool {
    let reason = format.lacks(run);
    if let Some(reason) = &reason {
        tracing::info!("left out: the format {} {reason}", format.name);
    }
    reason.is_none()
}

fn unknown(name: &str) -> PipelineError {
    let elsewhere = ELSEWHERE.iter().find(|(format, _)| *format == name);
    PipelineError::usage(&elsewhere.map_or_else(
        || format!("there is no format {name:?}; --format list lists the formats"),
        |(_, how)| format!("this command cannot write {name}: {how}"),
    ))
}
