//! `roadplane traffic`: tables of traffic from finished runs.

use roadplane_pipeline::{
    Existing, FolderLock, PipelineError, TrafficConfig, TrafficOptions, Units, traffic as figures,
    write_traffic, write_traffic_pictures,
};
use roadplane_terminal::Outcome;
use roadplane_write::OutputFolder;

use super::split;
use crate::args::traffic::{SpeedUnits, TrafficArgs};

/// Reads the runs, and writes the tables.
pub fn traffic(args: &TrafficArgs) -> anyhow::Result<Outcome> {
    let units = match args.units {
        SpeedUnits::Kmh => Units::Kmh,
        SpeedUnits::Mph => Units::Mph,
    };
    let tables = TrafficConfig {
        gates: args.gates.clone(),
        every: args.every.clone(),
        time_zone: args.time_zone.clone(),
        units,
        ..TrafficConfig::default()
    };
    let options = TrafficOptions { tables, start: args.start.clone(), camera_id: args.camera_id.clone() };
    let mut report = figures(&args.runs, &options)?;
    for warning in &report.file.warnings {
        tracing::warn!("{warning}");
    }
    let (parent, name) = split(&args.out)?;
    let existing = if args.overwrite { Existing::Overwrite } else { Existing::Refuse };
    let _lock = FolderLock::acquire(&parent).map_err(PipelineError::from)?;
    let written = OutputFolder::write(&parent, &name, existing, |folder| {
        write_traffic_pictures(&report, folder)?;
        write_traffic(&mut report, folder)
    })?;
    let vehicles: u64 = report.file.cameras.iter().flat_map(|c| &c.clips).map(|clip| clip.vehicles).sum();
    tracing::info!(
        "{vehicles} vehicles, {} crossings: {}",
        report.file.figures.crossings.len(),
        written.display()
    );
    Ok(Outcome::Done)
}
