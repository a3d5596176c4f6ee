//! `roadplane export`: a finished run in the formats of others.

use std::io::{Write as _, stdout};

use roadplane_export::{FORMATS, Format, Place, Run, export as write, read_points};
use roadplane_pipeline::{Existing, FolderLock, PipelineError};

use crate::Outcome;
use crate::args::export::ExportArgs;

/// Formats that need more than this program, and how to get them.
const ELSEWHERE: [(&str, &str); 1] = [(
    "rerun",
    "a recording for Rerun's viewer; made by scripts/export/rerun RUN FILE.rrd, which sets up Rerun's Python package",
)];

/// Writes a run in each format asked for.
pub fn export(args: &ExportArgs) -> anyhow::Result<Outcome> {
    if args.format.iter().any(|name| name == "list") {
        let holds = FORMATS.iter().map(|format| (format.name, format.holds));
        for (name, holds) in holds.chain(ELSEWHERE) {
            writeln!(stdout(), "{name:9} {holds}")?;
        }
        return Ok(Outcome::Done);
    }
    let (Some(run), Some(out)) = (&args.run, &args.out) else {
        return Err(PipelineError::usage("export needs the folder of a run and --out FOLDER").into());
    };
    let mut formats: Vec<&Format> = Vec::new();
    for name in &args.format {
        let format = Format::of(name).ok_or_else(|| unknown(name))?;
        if !formats.iter().any(|known| known.name == format.name) {
            formats.push(format);
        }
    }
    let mut run = Run::read(run).map_err(PipelineError::from)?;
    put_on_map(args, &mut run)?;
    let _lock = FolderLock::acquire(out).map_err(PipelineError::from)?;
    let existing = if args.overwrite { Existing::Overwrite } else { Existing::Refuse };
    for folder in write(&run, &formats, out, existing).map_err(PipelineError::from)? {
        tracing::info!("{}", folder.display());
    }
    Ok(Outcome::Done)
}

fn put_on_map(args: &ExportArgs, run: &mut Run) -> anyhow::Result<()> {
    let refused = |what: String, option: &str| PipelineError::usage(&format!("{option}: {what}"));
    let place = if let Some(file) = &args.geo {
        let points = read_points(file).map_err(PipelineError::from)?;
        run.put_on_map(|camera| Place::from_points(camera, &points)).map_err(|e| refused(e, "--geo"))?
    } else if let Some(numbers) = args.camera_at.as_deref() {
        let [latitude, longitude, bearing] = numbers else {
            return Err(refused("three numbers, LAT,LON,BEARING".to_owned(), "--camera-at").into());
        };
        let at = [*latitude, *longitude];
        run.put_on_map(|camera| Place::from_camera(camera, at, *bearing))
            .map_err(|e| refused(e, "--camera-at"))?
    } else {
        return Ok(());
    };
    let fit = &place.fit;
    let distances: Vec<String> = fit.residuals_m.iter().map(|[x, y]| format!("{:.2}", x.hypot(*y))).collect();
    tracing::info!(
        "the camera stands at {:.7}, {:.7} (UTM zone {}, sd {:.2} and {:.2} m) and looks {:.1}° ± {:.1}° from north; scale {:.3}, \
         focal length {:.0} ± {:.0} px, height {:.2} ± {:.2} m; residuals [{}] m",
        fit.camera_at[0],
        fit.camera_at[1],
        fit.zone,
        fit.camera_sd_m[0],
        fit.camera_sd_m[1],
        fit.bearing_deg,
        fit.bearing_sd_deg,
        fit.scale,
        fit.focal_px,
        fit.focal_sd_px,
        fit.height_m,
        fit.height_sd_m,
        distances.join(", ")
    );
    for warning in &fit.warnings {
        tracing::warn!("{warning}");
    }
    Ok(())
}

fn unknown(name: &str) -> PipelineError {
    let elsewhere = ELSEWHERE.iter().find(|(format, _)| *format == name);
    PipelineError::usage(&elsewhere.map_or_else(
        || format!("there is no format {name:?}; --format list says what there is"),
        |(_, how)| format!("{name} is not written by this command: {how}"),
    ))
}
