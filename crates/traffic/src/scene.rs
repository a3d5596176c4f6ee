//! The layout of a scene, found from the paths of its vehicles: arms, lanes, stop lines and flows.

mod arm;
mod border;
mod cluster;
mod corridor;
mod lane;
mod mixture;
mod names;
mod path;
mod reference;
mod ribbons;
mod roads;
mod stops;
mod trips;

pub use arm::{Arm, Flow};
pub(crate) use border::HALF_LANE_M;
pub use lane::{Lane, Stay, StopLine};

use nalgebra::Vector2;

use crate::{Clip, Gate, Zone};
use path::Path;

/// Largest number of paths that places and lanes are estimated from. More paths do not change them visibly, and take
/// longer.
const MOST_PATHS: usize = 2000;
/// Least probability that a vehicle exists.
const LEAST_EXISTS_P: f64 = 0.5;

/// The layout of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Roads on which vehicles come into view or leave it, clockwise around the scene from the viewing direction.
    pub arms: Vec<Arm>,
    /// Ribbons of common paths.
    pub lanes: Vec<Lane>,
    /// Places where queues begin.
    pub stop_lines: Vec<StopLine>,
    /// Pairs of arms with three or more vehicles between them, sorted by arms.
    pub flows: Vec<Flow>,
}

/// Returns the layout of a scene from clips of one camera. All clips have the same world frame: the origin is below the
/// camera, and y is the viewing direction.
///
/// `north_rad` is the bearing of the world's y axis, clockwise from north. If it is given, arms are named by the
/// compass. Otherwise they are numbered. The result does not depend on the order of clips, but for the index of a clip
/// in `Stay`.
#[must_use]
pub fn find_scene(clips: &[&Clip], north_rad: Option<f64>) -> Scene {
    let exists = |clip: usize, vehicle: usize| clips[clip].vehicles[vehicle].exists_p >= LEAST_EXISTS_P;
    let all =
        (0..clips.len()).flat_map(|clip| (0..clips[clip].vehicles.len()).map(move |vehicle| (clip, vehicle)));
    let paths: Vec<Path> =
        all.filter(|&(i, k)| exists(i, k)).filter_map(|(i, k)| Path::new(clips, i, k)).collect();
    let every = paths.len().div_ceil(MOST_PATHS).max(1);
    let some: Vec<Path> = paths.iter().step_by(every).cloned().collect();

    let found = roads::sections(&some);
    let places: Vec<_> = found.iter().map(|section| (section.middle, section.outward)).collect();
    let named = names::named(&places, north_rad);
    let sections: Vec<_> = named.iter().map(|(i, _)| found[*i].clone()).collect();
    let trips: Vec<_> = paths.iter().map(|path| trips::trip(path, &sections)).collect();
    let arm = |(i, (_, name)): (usize, &(usize, String))| Arm {
        gate: Gate { name: name.clone(), line: sections[i].ends().to_vec(), shared_sd_m: 0.0 },
        outward: sections[i].outward,
        entered: trips.iter().filter(|trip| trip.from == Some(i)).count(),
        left: trips.iter().filter(|trip| trip.to == Some(i)).count(),
    };
    let arms: Vec<Arm> = named.iter().enumerate().map(arm).collect();
    let flows = trips::flows(&trips, arms.len());
    let track_of = |path: &Path| clips[path.clip].vehicles[path.vehicle].track;
    let few: Vec<_> = trips.iter().copied().step_by(every).collect();
    let lanes = ribbons::lanes(&some, &few, &flows, &track_of);
    let stop_lines = stops::stop_lines(clips, &some, &lanes);
    Scene { arms, lanes, stop_lines, flows }
}

/// Length of the area before a stop line, m. Longer queues end in the next area, or out of view.
const QUEUE_M: f64 = 60.0;
/// Part of the area beyond the mean place of the front bumpers, m.
const BEYOND_M: f64 = 1.0;

impl Scene {
    /// Returns the area of the queues at each stop line: its lane, up to the line.
    #[must_use]
    pub fn queue_zones(&self) -> Vec<Zone> {
        let areas = self.stop_lines.iter().filter_map(|line| before(&self.lanes[line.lane?], &line.place));
        let zone = |(i, outline)| Zone { name: format!("stop line {}", i + 1), outline };
        areas.enumerate().map(zone).collect()
    }
}

/// Returns the outline of the part of a lane before a place on it.
fn before(lane: &Lane, place: &Vector2<f64>) -> Option<Vec<Vector2<f64>>> {
    let away = |point: &Vector2<f64>| (point - place).norm();
    let nearest =
        (0..lane.middle.len()).min_by(|a, b| away(&lane.middle[*a]).total_cmp(&away(&lane.middle[*b])))?;
    let mut middle: Vec<Vector2<f64>> = Vec::new();
    let mut length_m = 0.0;
    for point in lane.middle[..=nearest].iter().rev() {
        length_m += middle.last().map_or(0.0, |last| (last - point).norm());
        middle.push(*point);
        if length_m > QUEUE_M {
            break;
        }
    }
    middle.reverse();
    let [.., one, last] = middle.as_slice() else { return None };
    let ahead = (last - one).try_normalize(0.0)?;
    let end = place + ahead * BEYOND_M;
    middle.pop();
    middle.retain(|point| (end - point).dot(&ahead) > 0.0);
    middle.push(end);
    let left = |i: usize| {
        let (a, b) = (middle[i.saturating_sub(1)], middle[(i + 1).min(middle.len() - 1)]);
        (b - a).try_normalize(0.0).map(|forward| Vector2::new(-forward.y, forward.x) * HALF_LANE_M)
    };
    let sides: Vec<Vector2<f64>> = (0..middle.len()).map(left).collect::<Option<_>>()?;
    let side = |sign: f64| middle.iter().zip(&sides).map(move |(point, left)| point + left * sign);
    (middle.len() > 1).then(|| side(1.0).chain(side(-1.0).rev()).collect())
}

#[cfg(test)]
mod tests;
