//! Where the paths of two vehicles meet, and when each vehicle is there.

use std::f64::consts::PI;

use nalgebra::Vector2;

use super::{
    conflict::ConflictKind,
    footprint::{Footprint, angle_rad},
    path::{CHUNK, Path},
};

/// Smallest angle between headings that do not follow each other, rad (30°; SSAM's limit of rear-end conflicts).
const FOLLOWING_RAD: f64 = PI / 6.0;
/// Smallest angle between opposite headings, rad (150°).
const ONCOMING_RAD: f64 = PI / 6.0 * 5.0;

/// An interval in which the second vehicle's path touches the first vehicle's path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    /// Whether the vehicle that was given second is the first one at the place.
    pub swapped: bool,
    pub kind: ConflictKind,
    /// Angle between the headings where the second vehicle enters, rad.
    pub angle_rad: f64,
    pub encroachment: Option<Encroachment>,
}

/// How two vehicles use a place one after the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encroachment {
    /// Post-encroachment time, s.
    pub pet_s: f64,
    /// Time at which the second vehicle enters, s.
    pub enters_s: f64,
    /// Place at which the second vehicle enters, m.
    pub place_m: Vector2<f64>,
    /// Derivative of the time by a shift of the second vehicle's path relative to the first one's, s/m.
    pub slope: Vector2<f64>,
    /// Time at which the first vehicle leaves, s.
    pub leaves_s: f64,
}

/// A contact of a moving footprint with a footprint at a node of the other path.
#[derive(Clone, Copy, Debug)]
struct Touch {
    travelled_m: f64,
    node: usize,
}

/// The contacts on a run of consecutive segments.
struct Run {
    enter: Touch,
    leave: Touch,
    /// First and last node of the other path that is touched.
    others: [usize; 2],
    /// First and last segment.
    segments: [usize; 2],
}

/// Returns the kind of a conflict from the angles between the headings (rad) where a vehicle enters the other one's path,
/// and where the second one leaves it.
pub(super) fn kind(entry_rad: f64, exit_rad: f64) -> ConflictKind {
    if entry_rad < FOLLOWING_RAD {
        ConflictKind::Following
    } else if exit_rad < FOLLOWING_RAD {
        ConflictKind::Merging
    } else if entry_rad.min(exit_rad) < ONCOMING_RAD {
        // A vehicle that turns across the oncoming lane may enter it at a small angle.
        ConflictKind::Crossing
    } else {
        ConflictKind::Oncoming
    }
}

/// Returns whether two paths meet, and the meeting with the shortest post-encroachment time up to `longest_pet_s`, else
/// any meeting on observed parts of the paths.
pub(super) fn meeting(a: &Path<'_>, b: &Path<'_>, longest_pet_s: f64) -> (bool, Option<Meeting>) {
    let (mut meets, mut best) = (false, None::<Meeting>);
    for (swapped, first, second) in [(false, a, b), (true, b, a)] {
        let mut runs = Runs { first, second, segment: 0 };
        let mut found = false;
        while let Some(start) = runs.enter() {
            found = true;
            let observed =
                start.enter.node < first.observed && start.segments[0] + 1 < second.observed.max(2);
            if !observed {
                break;
            }
            let mut entry_rad = angle_between(first, second, &start.enter);
            let comes_second = comes_second(first, second, &start.enter, swapped);
            if entry_rad < FOLLOWING_RAD {
                if !comes_second {
                    // The other order of the two finds this meeting.
                    break;
                }
                // A vehicle that turned into the lane ahead of another one entered that one's path at a larger angle.
                let turned = Runs { first: second, second: first, segment: 0 }.enter();
                entry_rad =
                    turned.map_or(entry_rad, |t| angle_between(second, first, &t.enter).max(entry_rad));
            }
            if entry_rad < FOLLOWING_RAD {
                // Vehicles in the same lane meet all along it. There is no place that one leaves and the other enters.
                let kind = ConflictKind::Following;
                return (true, Some(Meeting { swapped, kind, angle_rad: entry_rad, encroachment: None }));
            }
            let run = runs.whole(start);
            if !enters_second(first, second, &run) {
                continue;
            }
            let kind = kind(entry_rad, angle_between(first, second, &run.leave));
            let encroachment = encroachment(first, second, &run, kind).filter(|e| e.pet_s <= longest_pet_s);
            let meeting = Meeting { swapped, kind, angle_rad: entry_rad, encroachment };
            let pet_s = |m: &Meeting| m.encroachment.map_or(f64::INFINITY, |e| e.pet_s);
            if best.as_ref().is_none_or(|best| pet_s(&meeting) < pet_s(best)) {
                best = Some(meeting);
            }
        }
        if !found {
            break;
        }
        meets = true;
    }
    (meets, best)
}

fn angle_between(first: &Path<'_>, second: &Path<'_>, touch: &Touch) -> f64 {
    angle_rad(&first.nodes[touch.node].forward, &second.at(touch.travelled_m).forward)
}

/// Whether the second vehicle is at a contact after the first one was there. If both are there from their first states on,
/// the second vehicle is behind the first one. If they are even side by side, `swapped` decides.
fn comes_second(first: &Path<'_>, second: &Path<'_>, touch: &Touch, swapped: bool) -> bool {
    let node = &first.nodes[touch.node];
    let later_s = second.first_s(touch.travelled_m) - first.first_s(node.travelled_m);
    let footprint = second.at(touch.travelled_m);
    let ahead_m = (node.centre - footprint.centre).dot(&(node.forward + footprint.forward));
    later_s > 0.0 || later_s == 0.0 && (ahead_m > 0.0 || ahead_m == 0.0 && !swapped)
}

/// Whether the first vehicle enters the area of a run before the second one.
fn enters_second(first: &Path<'_>, second: &Path<'_>, run: &Run) -> bool {
    let entries_m = area(second, run).flat_map(|place| touches(first, run, place)).map(|[(_, from), _]| from);
    let entered_s = first.first_s(entries_m.fold(f64::INFINITY, f64::min));
    let enters_s = second.first_s(run.enter.travelled_m);
    entered_s < enters_s || entered_s == enters_s && first.vehicle.track < second.vehicle.track
}

/// Returns the second vehicle's footprints at the nodes of a run.
fn area<'a>(second: &'a Path<'_>, run: &Run) -> impl Iterator<Item = Footprint> + 'a {
    (run.segments[0]..=(run.segments[1] + 1).min(second.nodes.len() - 1)).map(|node| second.at_node(node))
}

/// Returns the first vehicle's segments and travelled distances (m) at which it begins and ceases to touch a place.
fn touches<'a>(
    first: &'a Path<'_>,
    run: &Run,
    place: Footprint,
) -> impl Iterator<Item = [(usize, f64); 2]> + 'a {
    let segments = run.others[0].saturating_sub(1)..=run.others[1].min(first.nodes.len() - 1);
    segments.filter_map(move |segment| {
        let (start, motion) = first.segment(segment);
        let shares = start.touch(&motion, &place, &Vector2::zeros())?;
        Some(shares.map(|share| (segment, first.on_segment_m(segment, share))))
    })
}

/// Returns the encroachment of a run, `None` if the vehicles were not observed at their entry and exit.
fn encroachment(first: &Path<'_>, second: &Path<'_>, run: &Run, kind: ConflictKind) -> Option<Encroachment> {
    let observed = |path: &Path<'_>, node: usize| node + 1 < path.observed;
    let seen_m = 1e-9..=second.nodes[second.observed - 1].travelled_m;
    if !seen_m.contains(&run.enter.travelled_m) || !observed(first, run.enter.node) {
        return None;
    }
    let enters_s = second.first_s(run.enter.travelled_m);
    second.vehicle.at(enters_s)?;
    // A little beyond the first contact, so that the footprints overlap.
    let entering = second.at(run.enter.travelled_m + 0.02);
    // Where paths merge, or lead against each other, the area has no end that matters.
    let whole = if kind == ConflictKind::Crossing { area(second, run).collect() } else { Vec::new() };
    let mut leaving: Option<((usize, f64), Footprint)> = None;
    for place in whole.into_iter().chain([entering]) {
        for [_, to] in touches(first, run, place) {
            // The margin keeps the first of equal distances, so that rounding does not choose.
            if leaving.is_none_or(|(best, _)| to.1 > best.1 + 1e-9) {
                leaving = Some((to, place));
            }
        }
    }
    let ((segment, leaving_m), place) = leaving?;
    if leaving_m >= first.nodes[first.observed - 1].travelled_m || !observed(first, segment) {
        return None;
    }
    let leaves_s = first.last_s(leaving_m);
    first.vehicle.at(leaves_s)?;
    // Implicit differentiation of the two contacts: a shift along an edge direction moves each contact in time.
    let (leave_axis, _) = first.at(leaving_m).separation(&place);
    let (enter_axis, _) = first.at_node(run.enter.node).separation(&entering);
    let leave_mps = velocity(first, leaving_m, leaves_s, -1.0).dot(&leave_axis).min(-SLOWEST_MPS);
    let enter_mps = velocity(second, run.enter.travelled_m, enters_s, 1.0).dot(&enter_axis).min(-SLOWEST_MPS);
    Some(Encroachment {
        pet_s: enters_s - leaves_s,
        enters_s,
        leaves_s,
        place_m: first.at_node(run.enter.node).contact(&entering),
        slope: -leave_axis / leave_mps - enter_axis / enter_mps,
    })
}

/// Lowest speed at which a vehicle enters or leaves, m/s. It keeps sds of times finite.
const SLOWEST_MPS: f64 = 0.1;

/// Returns the velocity at a travelled distance (m), m/s, from the distance around it.
fn velocity(path: &Path<'_>, travelled_m: f64, time_s: f64, side: f64) -> Vector2<f64> {
    let other_m = travelled_m + side * 0.25;
    let other_s = if side < 0.0 { path.last_s(other_m) } else { path.first_s(other_m) };
    let passed_s = (other_s - time_s).abs();
    let moved_m = (path.at(other_m).centre - path.at(travelled_m).centre) * side;
    if passed_s > 1e-6 { moved_m / passed_s } else { Vector2::zeros() }
}

/// The runs of segments of the second path that touch nodes of the first path, in order.
struct Runs<'a> {
    first: &'a Path<'a>,
    second: &'a Path<'a>,
    segment: usize,
}

impl Runs<'_> {
    /// Returns the entry, the exit, and the first and last touched node of a segment.
    fn touched(&self, segment: usize) -> Option<(Touch, Touch, [usize; 2])> {
        let (start, motion) = self.second.segment(segment);
        let length_m = motion.norm();
        let near_m = self.first.radius_m + self.second.radius_m + length_m / 2.0;
        let middle = start.centre + motion / 2.0;
        let bounds = &self.second.chunks[segment / CHUNK];
        let mut found: Option<(Touch, Touch, [usize; 2])> = None;
        for (chunk, other) in self.first.chunks.iter().enumerate() {
            if !bounds.meet(other) {
                continue;
            }
            for node in chunk * CHUNK..((chunk + 1) * CHUNK).min(self.first.nodes.len()) {
                if (self.first.nodes[node].centre - middle).norm_squared() > near_m * near_m {
                    continue;
                }
                let Some(shares) = start.touch(&motion, &self.first.at_node(node), &Vector2::zeros()) else {
                    continue;
                };
                let [from, to] =
                    shares.map(|share| Touch { travelled_m: self.second.on_segment_m(segment, share), node });
                let (enter, leave, nodes) = found.get_or_insert((from, to, [node, node]));
                if from.travelled_m < enter.travelled_m - 1e-9 {
                    *enter = from;
                }
                if to.travelled_m > leave.travelled_m + 1e-9 {
                    *leave = to;
                }
                nodes[1] = node;
            }
        }
        found
    }

    /// Returns the first segment of the next run.
    fn enter(&mut self) -> Option<Run> {
        while self.segment < self.segments() {
            let segment = self.segment;
            let chunk = &self.second.chunks[segment / CHUNK];
            if segment.is_multiple_of(CHUNK) && !chunk.meet(&self.first.bounds) {
                self.segment += CHUNK;
                continue;
            }
            self.segment += 1;
            if let Some((enter, leave, others)) = self.touched(segment) {
                return Some(Run { enter, leave, others, segments: [segment, segment] });
            }
        }
        None
    }

    /// Returns a run with all its segments.
    fn whole(&mut self, mut run: Run) -> Run {
        while self.segment < self.segments() {
            self.segment += 1;
            let Some((_, leave, others)) = self.touched(self.segment - 1) else { break };
            run.leave = leave;
            run.segments[1] = self.segment - 1;
            run.others = [run.others[0].min(others[0]), run.others[1].max(others[1])];
        }
        run
    }

    fn segments(&self) -> usize {
        (self.second.nodes.len() - 1).max(1)
    }
}
