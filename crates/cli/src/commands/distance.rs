//! `roadplane distance`: the distance between two tracks of a finished run.

use std::io::{Write as _, stdout};

use roadplane_pipeline::distances;

use crate::args::DistanceArgs;
use roadplane_terminal::Outcome;

/// Prints CSV with the time, the distance and the standard deviation of the distance.
pub fn distance(args: &DistanceArgs) -> anyhow::Result<Outcome> {
    let found = distances(&args.run, [args.first, args.second], args.at)?;
    let mut out = stdout().lock();
    writeln!(out, "time_s,distance_m,distance_sd_m")?;
    for distance in found {
        writeln!(out, "{:.3},{:.3},{:.3}", distance.time_s, distance.distance_m, distance.sd_m)?;
    }
    Ok(Outcome::Done)
}
