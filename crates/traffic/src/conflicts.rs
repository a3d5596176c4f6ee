//! Conflicts between vehicles: post-encroachment time, time to collision, and deceleration to avoid a crash.
//!
//! Vehicles are rectangles of their length and width (footprints), not points.
//!
//! # Definitions
//! - *Post-encroachment time* (PET): the time from the exit of the first vehicle from the conflict area to the entry of the
//!   second one (Allen, Shin and Cooper 1978). The conflict area is the intersection of the areas that the two vehicles
//!   cover on their paths. Where paths merge or lead against each other, it is the footprint with which the second vehicle
//!   enters. Vehicles that follow each other have no PET, because their area does not end. They have headways.
//! - *Time to collision* (TTC): the time until the footprints touch if both vehicles keep their speeds (Hayward 1972).
//!   They go along their paths ([`Projection`]). In a lane it is gap / (v₂ − v₁).
//! - *Deceleration rate to avoid a crash* (DRAC): the smallest constant deceleration of one vehicle with which the
//!   footprints never touch (Cooper and Ferguson 1976; Almqvist, Hydén and Risser 1991). The other vehicle keeps its
//!   speed. The smaller value of the two vehicles counts.
//!     - In a lane it is (v₂ − v₁)² / (2 gap).
//!     - At a crossing it is 2 (v₂ − d/t)/t. Here d is the vehicle's distance to the conflict area, and t is the time
//!       until the other one leaves it. If the vehicle has to stop before (d < v₂ t/2), it is v₂²/(2 d).
//! - *Kinds*: by angles between the headings, where the vehicles enter each other's path and where the second one leaves
//!   the first one's. The limit of 30° is that of SSAM (Gettman and others 2008, FHWA-HRT-08-051).
//!
//! # Errors
//! A vehicle's own errors of position and speed count as constant during the encounter. The headings and sizes count as
//! exact. Sds are first-order, by implicit differentiation of the contact. A shift δ of a path changes a contact along the
//! unit vector n by δ·n. It changes the time of the contact by δ·n divided by the closing speed along n.
//!
//! The variance of a TTC of τ is (σ_p² + τ² σ_v²) / (n·Δv)². The probability below a limit uses τ at the limit, so it is
//! exact for vehicles in a lane. The variance of the DRAC sums the squares of central differences. The shared scale
//! multiplies distances and speeds alike, so it cancels in PET and TTC. The DRAC is proportional to it.

mod conflict;
mod footprint;
mod meeting;
mod pair;
mod path;
mod projection;
mod sound;

pub use conflict::{Conflict, ConflictKind, ConflictLimits, Projection};
pub(crate) use sound::sound;

use crate::Clip;
use path::Path;

/// Returns the conflicts between the vehicles of a clip that pass a limit, in the order of time.
///
/// There is one conflict per pair of vehicles: the worst values of all their encounters. Vehicles without a size and
/// vehicles with numbers that are not finite are left out.
#[must_use]
pub fn conflicts(clip: &Clip, limits: &ConflictLimits) -> Vec<Conflict> {
    let mut vehicles: Vec<_> = clip.vehicles.iter().collect();
    vehicles.sort_by(|a, b| a.span_s()[0].total_cmp(&b.span_s()[0]).then(a.track.cmp(&b.track)));
    let mut found = Vec::new();
    // Paths that are present, or were present less than the longest PET before. The paths of a day would need much memory.
    let mut recent: Vec<Path<'_>> = Vec::new();
    for path in vehicles.into_iter().filter_map(|vehicle| Path::new(vehicle, limits.horizon_s)) {
        let start_s = path.vehicle.span_s()[0];
        recent.retain(|other| other.vehicle.span_s()[1] + limits.pet_s.max(0.0) >= start_s);
        for other in recent.iter().filter(|other| other.bounds.meet(&path.bounds)) {
            let (a, b) =
                if other.vehicle.track <= path.vehicle.track { (other, &path) } else { (&path, other) };
            found.extend(pair::conflict(a, b, clip.scale_sd, limits));
        }
        recent.push(path);
    }
    let order = |c: &Conflict| (c.first, c.second);
    found.sort_by(|a, b| a.at_s.total_cmp(&b.at_s).then(order(a).cmp(&order(b))));
    found
}
