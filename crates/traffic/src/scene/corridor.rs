//! The road of an arm, followed from its outer end into the scene, and the gate across it.

use nalgebra::Vector2;

use super::{
    border::{Event, HALF_LANE_M, SAME_DIRECTION_COS},
    cluster::{FEWEST, LINK_ACROSS_M},
    path::Path,
};

/// Step along the road, m.
const STEP_M: f64 = 2.0;
/// Depth to which a road is followed, m, at most half of the vehicles' paths. Vehicles on a straight road are found at
/// distances that differ by about this.
const DEEPEST_M: f64 = 60.0;
/// Share of the vehicles that must cross the gate, relative to the best place for a gate.
const CROSS_SHARE: f64 = 0.95;

/// Cosine of the largest angle between a vehicle that crosses a line and the road: 60°.
const ACROSS_COS: f64 = 0.5;

/// A line across a road.
#[derive(Clone, Debug)]
pub(super) struct Section {
    /// Middle of the line, m.
    pub middle: Vector2<f64>,
    /// Unit vector along the road, out of the scene.
    pub outward: Vector2<f64>,
    /// Half the length of the line, m.
    pub half_m: f64,
}

/// A vehicle on a section.
struct Crossing {
    aside_m: f64,
    outward: Vector2<f64>,
}

impl Section {
    /// Returns the side of the line on which positions across the road are positive.
    fn side(&self) -> Vector2<f64> {
        Vector2::new(-self.outward.y, self.outward.x)
    }

    /// Returns the two ends of the line. Seen from the first, the inside of the scene is to the right.
    pub(super) fn ends(&self) -> [Vector2<f64>; 2] {
        [self.middle + self.side() * self.half_m, self.middle - self.side() * self.half_m]
    }

    /// Returns the crossings of a path, in order: whether it comes into the scene, and its distance along the path, m.
    /// `wider_m` is added to both ends of the line.
    pub(super) fn crossings(&self, path: &Path, wider_m: f64) -> impl Iterator<Item = (bool, f64, f64)> {
        let side = self.side();
        path.points.windows(2).filter_map(move |pair| {
            let [a, b] = [0, 1].map(|i| pair[i].at - self.middle);
            let (from, to) = (a.dot(&self.outward), b.dot(&self.outward));
            // A vehicle along the line crosses it only by its noise.
            if (from > 0.0) == (to > 0.0) || (to - from).abs() < ACROSS_COS * (b - a).norm() {
                return None;
            }
            let share = from / (from - to);
            let aside_m = a.dot(&side) * (1.0 - share) + b.dot(&side) * share;
            let along_m = pair[0].along_m * (1.0 - share) + pair[1].along_m * share;
            (aside_m.abs() <= self.half_m + wider_m).then_some((from > 0.0, along_m, aside_m))
        })
    }
}

/// Returns the line across the road of a group of events, at the outermost place that nearly all its vehicles cross,
/// and one step farther inside. `None` if fewer than `FEWEST` vehicles cross it, or if most vehicles that cross it were
/// followed beyond the road's outer end: then vehicles were lost here.
pub(super) fn gate_section(paths: &[Path], events: &[Event]) -> Option<Section> {
    let mut sections = follow(paths, events);
    let counts: Vec<usize> = sections.iter().map(|(_, crossings)| crossings.len()).collect();
    let most = *counts.iter().max()? as f64;
    let outermost = counts.iter().position(|&count| count as f64 >= CROSS_SHARE * most)?;
    let inside = (outermost + 1).min(sections.len() - 1);
    // The better of the two places, if the road ends right behind the outer one.
    let chosen = if counts[inside] as f64 >= CROSS_SHARE * most { inside } else { outermost };
    let (section, crossings) = sections.swap_remove(chosen);
    let all: Vec<[bool; 2]> = paths.iter().map(|path| [path.ends, path.begins]).collect();
    let reach = Section { half_m: section.half_m + LINK_ACROSS_M, ..section.clone() };
    if crossings.len() < FEWEST || 2 * crossings.len() <= self::crossings(paths, &all, &reach).len() {
        return None;
    }
    let low = crossings.iter().map(|crossing| crossing.aside_m).fold(f64::INFINITY, f64::min);
    let high = crossings.iter().map(|crossing| crossing.aside_m).fold(f64::NEG_INFINITY, f64::max);
    let middle = section.middle + section.side() * (low + high) / 2.0;
    (high >= low).then_some(Section { middle, half_m: (high - low) / 2.0 + HALF_LANE_M, ..section })
}

/// Follows a road inwards and returns the sections with the vehicles whose outer end is on the road and that cross it.
fn follow(paths: &[Path], events: &[Event]) -> Vec<(Section, Vec<Crossing>)> {
    let mean = |of: &dyn Fn(&Event) -> Vector2<f64>| {
        events.iter().map(of).sum::<Vector2<f64>>() / events.len() as f64
    };
    let Some(mut outward) = mean(&|event| event.outward).try_normalize(0.0) else { return Vec::new() };
    let centre = mean(&|event| event.at);
    let start = events.iter().map(|event| (event.at - centre).dot(&outward)).fold(0.0, f64::max);
    let mut middle = centre + outward * start;
    let mut lengths: Vec<f64> = events.iter().map(|event| paths[event.path].length_m()).collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let deepest_m = start + DEEPEST_M.min(lengths[lengths.len() / 2] / 2.0);
    let aside_of = |point: Vector2<f64>| (point - centre).dot(&Vector2::new(-outward.y, outward.x)).abs();
    let mut half_m = events.iter().map(|event| aside_of(event.at)).fold(0.0, f64::max);

    // Ends of paths that the road has reached. A vehicle that stops here, or is cut by the clip, has no such end.
    let mut reached = vec![[false; 2]; paths.len()];
    let mut sections = Vec::new();
    let mut most_members = 0;
    for step in 0..=(deepest_m / STEP_M) as usize {
        let reach = Section { middle, outward, half_m: half_m + LINK_ACROSS_M };
        for (i, path) in paths.iter().enumerate() {
            for (is_end, enters) in [(path.begins, true), (path.ends, false)] {
                let point = &path.points[if enters { 0 } else { path.points.len() - 1 }];
                let away = point.at - middle;
                let same =
                    point.forward.dot(&outward) * if enters { -1.0 } else { 1.0 } >= SAME_DIRECTION_COS;
                let beside = away.dot(&reach.side()).abs() <= reach.half_m;
                let depth = away.dot(&outward);
                reached[i][usize::from(enters)] |=
                    is_end && same && beside && (0.0..2.0 * STEP_M).contains(&depth);
            }
        }
        for event in events.iter().filter(|event| (event.at - middle).dot(&outward) >= 0.0) {
            reached[event.path][usize::from(event.enters)] = true;
        }
        let crossings = crossings(paths, &reached, &reach);
        let members = crossings.len();
        most_members = most_members.max(members);
        if step > 0 && 2 * members < most_members {
            break;
        }
        if members > 0 {
            let count = members as f64;
            let turned = crossings.iter().map(|crossing| crossing.outward).sum::<Vector2<f64>>();
            let low = crossings.iter().map(|crossing| crossing.aside_m).fold(f64::INFINITY, f64::min);
            let high = crossings.iter().map(|crossing| crossing.aside_m).fold(f64::NEG_INFINITY, f64::max);
            let next = turned.try_normalize(0.0).unwrap_or(outward);
            sections.push((Section { middle, outward, half_m }, crossings));
            middle += reach.side() * (low + high) / 2.0;
            half_m = (high - low) / 2.0;
            // A few vehicles must not turn the road.
            let weight = count / (count + 3.0);
            outward = (outward * (1.0 - weight) + next * weight).try_normalize(0.0).unwrap_or(outward);
        }
        middle -= outward * STEP_M;
    }
    sections
}

/// Returns the vehicles with a reached end that cross a section along the road.
fn crossings(paths: &[Path], reached: &[[bool; 2]], section: &Section) -> Vec<Crossing> {
    let mut found = Vec::new();
    for (i, path) in paths.iter().enumerate() {
        for enters in [true, false] {
            if !reached[i][usize::from(enters)] {
                continue;
            }
            let mut all = section.crossings(path, 0.0).filter(|crossing| crossing.0 == enters);
            let crossing = if enters { all.next() } else { all.last() };
            let Some((_, along_m, aside_m)) = crossing else { continue };
            let k = path.points.partition_point(|point| point.along_m < along_m).min(path.points.len() - 1);
            let outward = path.points[k].forward * if enters { -1.0 } else { 1.0 };
            if outward.dot(&section.outward) >= SAME_DIRECTION_COS {
                found.push(Crossing { aside_m, outward });
            }
        }
    }
    found
}
