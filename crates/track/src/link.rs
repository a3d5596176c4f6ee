//! Which tracklet goes on as which: all continuations are chosen together, by what comes before and after.
//!
//! A tracklet (sightings that follow each other beyond doubt, `tracker.rs`) goes on as at most one other and is the
//! continuation of at most one other: a path cover of least cost, which is data association as a min-cost flow (Zhang, Li and
//! Nevatia 2008, "Global Data Association for Multi-Object Tracking Using Network Flows") on the ground plane, where a pixel's
//! uncertainty is what the pose's covariance says (as UCMCTrack, Yi et al. 2024). With costs by pair only, the flow is an
//! assignment of ends to beginnings, and falls apart into groups that cannot reach each other.
//!
//! A pair gains the log likelihood ratio of "the same vehicle, unseen for a while" against "one left, another appeared":
//!
//! ```text
//! log Σ_mode P(mode, Δt) p(place, velocity after | before, mode) − log λ p(velocity) + what class and size say
//! ```
//!
//! with three ways to be unseen: it stood, it drove on, it crept on in a queue. Tracklets that overlap for a moment, as parts of one
//! vehicle do where something begins to hide it, are such a pair, too: the earlier one then counts up to where the later begins.

use std::{collections::BTreeMap, f64::consts::PI, ops::AddAssign as _};

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use roadplane_base::{assign, bbox_iou, fold_axis, upper_median};

use crate::{
    measurement::Sighting,
    raw_track::{RawTrack, VOTES, share_space},
};

/// Sightings of an end that tell how the vehicle moved there: of so long, s, at most so many.
const END_S: f64 = 1.0;
const END_SIGHTINGS: usize = 12;
/// Share of a sighting's variance that its neighbours have in common.
const SHARED: f64 = 0.5;
/// sd of the velocity of vehicles that drive, and of those that stand, m/s.
const DRIVING_SD: f64 = 8.0;
const STANDING_SD: f64 = 0.2;
/// Share of vehicles that stand where they are first found.
const STANDING_SHARE: f64 = 0.1;
/// Wandering of a standing vehicle's estimates, m.
const RESTING_M: f64 = 0.2;
/// White acceleration of a vehicle that drives unseen, m²/s³.
const ACCELERATION_POWER: f64 = 3.0;
/// How long a vehicle stays unseen while it stands, drives, creeps (mean of an exponential distribution), s.
const STANDS_S: f64 = 20.0;
const DRIVES_S: f64 = 1.2;
const CREEPS_S: f64 = 6.0;
/// A vehicle that something hides in part may be two tracklets for so long, s.
const MAX_TOGETHER_S: f64 = 0.5;
/// Nobody drives, or creeps, unseen for longer, s: whoever is found then may be anybody.
const MAX_DRIVES_S: f64 = 4.0;
const MAX_CREEPS_S: f64 = 10.0;
/// Shares of these three ways.
const SHARES: [f64; 3] = [0.4, 0.45, 0.15];
/// Longest way and greatest speed of creeping, m and m/s; sd of what it leaves the line by, m.
const CREEP_M: f64 = 20.0;
const CREEP_MPS: f64 = 2.5;
const LINE_M: f64 = 0.6;
/// Vehicles that appear, per m²: anywhere, and where they may: at the picture's edge, and far off, where boxes are so small, px.
const APPEARS: f64 = 2e-5;
const ENTERS: f64 = 5e-4;
/// The same where the picture cuts the vehicle: they all come and go in the same few places.
const ENTERS_AT_EDGE: f64 = 1e-2;
const SMALL_PX: f64 = 28.0;
/// How much likelier it is that a vehicle is gone for good where it can leave the picture (log).
const LEAVES: f64 = 2.0;
/// A way longer than this, m, shows where it leads; it leaves the vehicle's axis by no more than this, rad, and goes backwards
/// no farther than this, m.
const WAY_M: f64 = 2.5;
const MAX_OFF_AXIS: f64 = 0.7;
const MAX_BACKWARDS_M: f64 = 8.0;
/// sd of the logarithm of a vehicle's size as its box and distance show it, from one view and from others.
const SIZE_SD: f64 = 0.15;
const TURNED_SIZE_SD: f64 = 0.5;
/// Votes that a class has beforehand.
const VOTE: f64 = 0.5;

/// Joins tracklets into tracks.
pub(crate) fn link(mut tracklets: Vec<RawTrack>, horizon_s: f64) -> Vec<RawTrack> {
    tracklets.retain(|track| !track.observations.is_empty());
    let starts: Vec<End> = tracklets.iter().map(|track| End::of(track, &track.observations, false)).collect();
    let ends: Vec<End> = tracklets.iter().map(|track| End::of(track, &track.observations, true)).collect();
    let mut gains: Vec<(usize, usize, f64)> = Vec::new();
    for (i, end) in ends.iter().enumerate() {
        for (j, start) in starts.iter().enumerate().filter(|(j, _)| *j != i) {
            let gap_s = start.time_s - end.time_s;
            if gap_s > horizon_s || gap_s < -MAX_TOGETHER_S {
                continue;
            }
            let gain = if gap_s > 0.0 {
                Some(gain(end, start, gap_s))
            } else {
                let before = before(&tracklets[i], &tracklets[j]);
                before.map(|end| gain(&end, start, start.time_s - end.time_s))
            };
            if let Some(gain) = gain.filter(|gain| *gain > 0.0) {
                gains.push((i, j, gain));
            }
        }
    }
    let next = choose(tracklets.len(), &gains);
    chains(tracklets, &next)
}

/// Where a tracklet was before another began, if for a moment both of them may be parts of one vehicle, and the other goes on.
fn before(track: &RawTrack, later: &RawTrack) -> Option<End> {
    let (first, last) = later.observations.first().zip(later.observations.last())?;
    let (alone, together) =
        track.observations.split_at(track.observations.partition_point(|o| o.frame < first.frame));
    let goes_on = track.observations.last().is_some_and(|end| end.frame < last.frame);
    let is_apart = |o: &Sighting| {
        let other = later.observations.binary_search_by_key(&o.frame, |other| other.frame);
        let other = other.ok().map(|i| &later.observations[i]);
        other.is_some_and(|other| bbox_iou(&o.bbox_px, &other.bbox_px) <= 0.0 || !share_space(o, other))
    };
    (goes_on && !alone.is_empty() && !together.iter().any(is_apart)).then(|| End::of(track, alone, true))
}

/// For each tracklet the one that it goes on as.
fn choose(count: usize, gains: &[(usize, usize, f64)]) -> Vec<Option<usize>> {
    // Ends are 0 … count, beginnings follow.
    let mut groups: Vec<usize> = (0..2 * count).collect();
    for &(i, j, _) in gains {
        let (a, b) = (root(&mut groups, i), root(&mut groups, count + j));
        groups[a.max(b)] = a.min(b);
    }
    let mut of_group: BTreeMap<usize, Vec<(usize, usize, f64)>> = BTreeMap::new();
    for &(i, j, gain) in gains {
        of_group.entry(root(&mut groups, i)).or_default().push((i, j, gain));
    }
    let mut next = vec![None; count];
    for pairs in of_group.values() {
        let sorted = |of: fn(&(usize, usize, f64)) -> usize| {
            let mut all: Vec<usize> = pairs.iter().map(of).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        let (rows, columns) = (sorted(|p| p.0), sorted(|p| p.1));
        let cost = |r: usize, c: usize| {
            let pair = pairs.iter().find(|p| p.0 == rows[r] && p.1 == columns[c]);
            pair.map_or(f64::INFINITY, |(_, _, gain)| -gain)
        };
        for (row, column) in assign(rows.len(), columns.len(), 0.0, cost).into_iter().enumerate() {
            next[rows[row]] = column.map(|c| columns[c]);
        }
    }
    next
}

fn root(groups: &mut [usize], mut of: usize) -> usize {
    while groups[of] != of {
        groups[of] = groups[groups[of]];
        of = groups[of];
    }
    of
}

fn chains(tracklets: Vec<RawTrack>, next: &[Option<usize>]) -> Vec<RawTrack> {
    let mut begins = vec![true; tracklets.len()];
    next.iter().flatten().for_each(|&j| begins[j] = false);
    let mut left: Vec<Option<RawTrack>> = tracklets.into_iter().map(Some).collect();
    let mut joined = Vec::new();
    for first in (0..left.len()).filter(|&i| begins[i]) {
        let Some(mut track) = left[first].take() else { continue };
        let mut at = first;
        while let Some(then) = next[at] {
            let Some(later) = left[then].take() else { break };
            let begins = later.observations.first().map_or(usize::MAX, |first| first.frame);
            track.observations.retain(|o| o.frame < begins);
            track.append(later);
            at = then;
        }
        joined.push(track);
    }
    joined
}

/// A tracklet where it begins or ends.
struct End {
    time_s: f64,
    /// Place and velocity, m and m/s, and their covariance.
    state: Vector4<f64>,
    covariance: Matrix4<f64>,
    axis: f64,
    axis_variance: f64,
    /// How likely it stands, 0–1.
    stands: f64,
    /// Density of its velocity among vehicles that stand, and among those that drive, (m/s)⁻².
    standing: f64,
    driving: f64,
    /// It may enter or leave here.
    border: bool,
    /// The picture cuts it off.
    at_edge: bool,
    /// Logarithm of its size: diagonal of the box times the distance.
    log_size: f64,
    votes: [f64; VOTES],
}

impl End {
    /// Of these of a track's sightings.
    fn of(track: &RawTrack, all: &[Sighting], last: bool) -> Self {
        let edge = if last { &all[all.len() - 1] } else { &all[0] };
        let near = |o: &&Sighting| (o.time_s - edge.time_s).abs() <= END_S;
        let part: Vec<&Sighting> = if last {
            all.iter().rev().take(END_SIGHTINGS).filter(near).collect()
        } else {
            all.iter().take(END_SIGHTINGS).filter(near).collect()
        };
        let (state, covariance) = motion(&part, edge.time_s);
        let (mut axis, mut weights) = (Vector2::zeros(), 0.0);
        for o in &part {
            let weight = 1.0 / (o.covariance[(2, 2)] + 1e-3);
            axis += Vector2::new((2.0 * o.pose.z).cos(), (2.0 * o.pose.z).sin()) * weight;
            weights += weight;
        }
        let velocity = state.fixed_rows::<2>(2).into_owned();
        let spread = covariance.fixed_view::<2, 2>(2, 2).into_owned();
        let [standing, driving] = [STANDING_SD, DRIVING_SD]
            .map(|sd| density(&velocity, &(spread + Matrix2::identity() * sd.powi(2))));
        let at_edge = edge.cut.contains(&true);
        let side = |b: &[f64; 4]| (b[2] - b[0]).max(b[3] - b[1]);
        let log_size = |o: &Sighting| {
            let [x0, y0, x1, y1] = o.bbox_px;
            ((x1 - x0).hypot(y1 - y0) * o.pose.xy().norm().max(1.0)).ln()
        };
        let mut sizes: Vec<f64> = part.iter().map(|o| log_size(o)).collect();
        Self {
            time_s: edge.time_s,
            state,
            covariance,
            axis: axis.y.atan2(axis.x) / 2.0,
            axis_variance: (part.len() as f64 / weights.max(1e-9)).min(1.0),
            stands: if edge.held { 1.0 } else { standing / (standing + driving).max(1e-300) },
            standing,
            driving,
            at_edge,
            border: at_edge || side(&edge.bbox_px) < SMALL_PX,
            log_size: upper_median(&mut sizes, f64::total_cmp).unwrap_or_default(),
            votes: track.votes(),
        }
    }

    fn velocity(&self) -> Vector2<f64> {
        self.state.fixed_rows::<2>(2).into_owned()
    }

    fn place_covariance(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(0, 0).into_owned()
    }

    fn velocity_covariance(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(2, 2).into_owned()
    }
}

/// Place and velocity at a time by a straight line through sightings, each with what it does not share with its neighbours as
/// noise.
fn motion(part: &[&Sighting], time_s: f64) -> (Vector4<f64>, Matrix4<f64>) {
    let mut information = Matrix4::zeros();
    information.fixed_view_mut::<2, 2>(2, 2).fill_diagonal((1.5 * DRIVING_SD).powi(-2));
    let mut weighted = Vector4::zeros();
    let mut shared = Matrix2::zeros();
    for o in part {
        let covariance = o.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        shared += covariance * (SHARED / part.len() as f64);
        let Some(precision) = (covariance * (1.0 - SHARED)).try_inverse() else { continue };
        let dt = o.time_s - time_s;
        information.fixed_view_mut::<2, 2>(0, 0).add_assign(&precision);
        information.fixed_view_mut::<2, 2>(0, 2).add_assign(&(precision * dt));
        information.fixed_view_mut::<2, 2>(2, 0).add_assign(&(precision * dt));
        information.fixed_view_mut::<2, 2>(2, 2).add_assign(&(precision * dt * dt));
        let at = precision * o.pose.xy();
        weighted.fixed_rows_mut::<2>(0).add_assign(&at);
        weighted.fixed_rows_mut::<2>(2).add_assign(&(at * dt));
    }
    let inverse = information.try_inverse().unwrap_or_else(Matrix4::identity);
    let mut covariance = (inverse + inverse.transpose()) / 2.0;
    covariance.fixed_view_mut::<2, 2>(0, 0).add_assign(&shared);
    (inverse * weighted, covariance)
}

fn density(x: &Vector2<f64>, covariance: &Matrix2<f64>) -> f64 {
    let Some(inverse) = covariance.try_inverse() else { return 0.0 };
    (-0.5 * x.dot(&(inverse * x))).exp() / (2.0 * PI * covariance.determinant().max(1e-300).sqrt())
}

/// Log likelihood ratio of one vehicle against two.
fn gain(end: &End, start: &End, gap_s: f64) -> f64 {
    let way = (start.state - end.state).fixed_rows::<2>(0).into_owned();
    if !can_drive(end, start, &way, gap_s) {
        return f64::NEG_INFINITY;
    }
    let places = end.place_covariance() + start.place_covariance();
    let eye = Matrix2::identity();
    let stood = {
        let unseen = (-gap_s / STANDS_S).exp();
        end.stands * unseen * density(&way, &(places + eye * RESTING_M.powi(2))) * start.standing
    };
    let drove =
        if gap_s > MAX_DRIVES_S { 0.0 } else { (-gap_s / DRIVES_S).exp() * drive_density(end, start, gap_s) };
    let crept = if gap_s > MAX_CREEPS_S {
        0.0
    } else {
        (-gap_s / CREEPS_S).exp() * creep_density(end, start, &way, &places, gap_s)
    };
    let same = SHARES[0] * stood + SHARES[1] * drove + SHARES[2] * crept;
    let appears = match (start.at_edge && end.at_edge, start.border) {
        (true, _) => ENTERS_AT_EDGE,
        (false, true) => ENTERS,
        (false, false) => APPEARS,
    };
    let new = appears * (STANDING_SHARE * start.standing + (1.0 - STANDING_SHARE) * start.driving);
    let gone = if end.border { LEAVES } else { 0.0 };
    (same.max(1e-300) / new.max(1e-300)).ln() - gone + class_gain(end, start) + size_gain(end, start)
}

/// Whether a vehicle can come from one to the other at all.
fn can_drive(end: &End, start: &End, way: &Vector2<f64>, gap_s: f64) -> bool {
    let sd = (end.place_covariance() + start.place_covariance()).trace().sqrt();
    let length = way.norm();
    if length < WAY_M + 2.0 * sd {
        return true;
    }
    let fastest = end.velocity().norm().max(start.velocity().norm()) + 3.0 * gap_s.min(4.0) + 2.0;
    if length > fastest * gap_s + 2.0 * sd {
        return false;
    }
    let known = end.axis_variance.max(start.axis_variance) < 0.1;
    let turned = fold_axis(start.axis - end.axis);
    let axis = end.axis + turned / 2.0;
    let off = fold_axis(way.y.atan2(way.x) - axis).abs();
    if known && off > MAX_OFF_AXIS + turned.abs() / 2.0 {
        return false;
    }
    let against = |v: &Vector2<f64>| v.norm() > 2.0 && v.dot(way) < 0.0;
    length < MAX_BACKWARDS_M || !(against(&end.velocity()) || against(&start.velocity()))
}

fn drive_density(end: &End, start: &End, gap_s: f64) -> f64 {
    let mut forward = Matrix4::identity();
    forward.fixed_view_mut::<2, 2>(0, 2).fill_diagonal(gap_s);
    let q = ACCELERATION_POWER;
    let mut noise = Matrix4::zeros();
    noise.fixed_view_mut::<2, 2>(0, 0).fill_diagonal(q * gap_s.powi(3) / 3.0 + 0.01);
    noise.fixed_view_mut::<2, 2>(0, 2).fill_diagonal(q * gap_s * gap_s / 2.0);
    noise.fixed_view_mut::<2, 2>(2, 0).fill_diagonal(q * gap_s * gap_s / 2.0);
    noise.fixed_view_mut::<2, 2>(2, 2).fill_diagonal(q * gap_s + 0.01);
    let spread = forward * end.covariance * forward.transpose() + noise + start.covariance;
    let away = start.state - forward * end.state;
    let Some(factor) = spread.cholesky() else { return 0.0 };
    let root: f64 = factor.l().diagonal().iter().product();
    (-0.5 * away.dot(&factor.solve(&away))).exp() / ((2.0 * PI).powi(2) * root.max(1e-300))
}

/// Stop and go behind something: ahead by any way that creeping covers, along the line that the vehicle points in.
fn creep_density(end: &End, start: &End, way: &Vector2<f64>, places: &Matrix2<f64>, gap_s: f64) -> f64 {
    let slow = (-0.5 * (end.velocity().norm() / CREEP_MPS).powi(2)).exp();
    let axis = end.axis + fold_axis(start.axis - end.axis) / 2.0;
    let (sin, cos) = axis.sin_cos();
    let (ahead, aside) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
    // The axis may point backwards; ways in which the vehicle moved before or after show which.
    let sign = (end.velocity() + start.velocity()).dot(&ahead);
    let along = way.dot(&ahead) * if sign < 0.0 { -1.0 } else { 1.0 };
    let sd = |direction: &Vector2<f64>| direction.dot(&(places * direction)).max(0.0);
    let reach = (CREEP_MPS * gap_s).min(CREEP_M);
    let beyond = if along < 0.0 { along } else { (along - reach).max(0.0) };
    let outside = (-0.5 * beyond * beyond / (sd(&ahead) + 0.25)).exp();
    let off = way.dot(&aside);
    let variance = sd(&aside) + LINE_M * LINE_M;
    let on_line = (-0.5 * off * off / variance).exp() / (2.0 * PI * variance).sqrt();
    let after = density(
        &start.velocity(),
        &(start.velocity_covariance() + Matrix2::identity() * (CREEP_MPS / 2.0).powi(2)),
    );
    slow * outside * on_line / (reach + 1.0) * after
}

/// What the votes for classes say: of one kind of vehicle against of any.
fn class_gain(end: &End, start: &End) -> f64 {
    let share = |votes: &[f64; VOTES], c: usize| {
        (votes[c] + VOTE) / (votes.iter().sum::<f64>() + VOTE * VOTES as f64)
    };
    let same: f64 = (0..VOTES).map(|c| share(&end.votes, c) * share(&start.votes, c)).sum();
    // Most vehicles are of one kind, so that agreeing says little and disagreeing much.
    (same / 0.6).ln().min(0.0)
}

/// The same for sizes; views from elsewhere show another.
fn size_gain(end: &End, start: &End) -> f64 {
    let turned = fold_axis(start.axis - end.axis).abs() > 0.4;
    let sd = if turned || end.border || start.border { TURNED_SIZE_SD } else { SIZE_SD };
    let off = (start.log_size - end.log_size) / sd;
    -0.5 * (off * off).min(25.0)
}
