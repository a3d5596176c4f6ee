//! Links tracklets: all continuations are chosen together, by the data before and after each gap.
//!
//! A tracklet holds detections that follow each other without doubt (`tracker.rs`). It has at most one continuation,
//! and continues at most one other tracklet. This is a path cover of least cost: data association as a min-cost flow
//! (Zhang, Li and Nevatia 2008, "Global Data Association for Multi-Object Tracking Using Network Flows"). It works on
//! the ground plane, where the pose's covariance gives the uncertainty (as in UCMCTrack, Yi et al. 2024). Costs belong
//! to pairs only, so the flow is an assignment of ends to beginnings. The assignment separates into groups that cannot
//! reach each other.
//!
//! A pair gains the log likelihood ratio of two hypotheses: "the same vehicle, undetected for a while" against "one
//! vehicle left and another appeared":
//!
//! ```text
//! log Σ_mode P(mode, Δt) p(position, velocity after | before, mode) / (λ + r τ_mode) − log p(velocity)
//!     + terms of class, size and colour
//! ```
//!
//! An undetected vehicle has three modes: it was stationary, it drove on, or it crept on in a queue. In each, τ is the
//! mean time for which it stays undetected. Vehicles appear anywhere with the density λ. Where the later tracklet
//! begins, others that drive appear at the rate r. So in flowing traffic, a vehicle is not the stationary one that was
//! there before.
//!
//! A vehicle may have two boxes for some frames. A tracklet that begins on one of them continues the tracklet that ends
//! on the other. The earlier one then counts only up to this beginning.
//!
//! A tracklet of boxes alone may be no vehicle. With the probability p that it is one (`existence.rs`), keeping it
//! apart from all others gains −log p. In the assignment, its end is then its own beginning.

use std::{collections::BTreeMap, f64::consts::PI, ops::AddAssign as _};

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use roadplane_base::{assign, bbox_iou, fold_axis, upper_median};

use crate::{
    colour::Colour,
    expected::{HALF_LANE_M, HIDDEN_S},
    filter::{MOTION_S, SPEED_SD, STANDING_MPS, STANDING_SHARE, STILL_M, driven, mixed},
    join::{features, probability},
    measurement::Sighting,
    noise::COMMON_SHARE,
    numbers::sigmoid,
    raw_track::{Link, RawTrack, Votes},
};

/// Mean time for which a stationary or creeping vehicle stays undetected, s (exponential distribution).
const STANDS_S: f64 = 20.0;
/// Mean time for which a driving vehicle stays undetected, s (exponential distribution).
const DRIVES_S: f64 = MOTION_S;
/// Prior probabilities of the three modes: stationary, driving, creeping.
const SHARES: [f64; 3] = [0.4, 0.45, 0.15];
/// Greatest speed of creeping, m/s.
const CREEP_MPS: f64 = 2.5;
/// Density of vehicles that appear anywhere, per m².
const APPEARS: f64 = 2e-5;
/// Sd of the logarithm of a vehicle's size (box diagonal times distance). Views and hidden parts change it.
const SIZE_SD: f64 = 0.3;
/// Votes that each class has in advance, in the order of `VehicleClass::ALL`. Nets confuse cars, trucks and buses with
/// each other, but hardly with motorcycles.
const PRIOR_VOTES: Votes = Votes::new(0.5, 0.5, 0.5, 0.0);

/// Joins tracklets into tracks. Gaps of up to [`HIDDEN_S`] are bridged. `log_odds` returns the log odds that a tracklet
/// is a vehicle; `None` for a tracklet that is one beyond doubt. With `cut`, links that are probably wrong are left out.
pub(crate) fn link(
    mut tracklets: Vec<RawTrack>,
    cut: bool,
    log_odds: impl Fn(&RawTrack) -> Option<f64>,
) -> Vec<RawTrack> {
    tracklets.retain(|track| !track.observations.is_empty());
    let starts: Vec<End> = tracklets.iter().map(|track| End::of(track, &track.observations, false)).collect();
    let ends: Vec<End> = tracklets.iter().map(|track| End::of(track, &track.observations, true)).collect();
    let exists_p: Vec<f64> = tracklets.iter().map(|track| log_odds(track).map_or(1.0, sigmoid)).collect();
    let arrivals = Arrivals::new(&starts, &ends);
    // A tracklet that continues itself stays apart: probably, it is no vehicle.
    let clutter = |(i, p): (usize, &f64)| (*p < 1.0).then(|| (i, i, -p.max(1e-300).ln()));
    let mut gains: Vec<(usize, usize, f64)> = exists_p.iter().enumerate().filter_map(clutter).collect();
    for (i, end) in ends.iter().enumerate() {
        for (j, start) in starts.iter().enumerate().filter(|(j, _)| *j != i) {
            let before = before_takeover(&tracklets[i], &tracklets[j]);
            let before = before.map(|part| End::of(&tracklets[i], part, true));
            let end = before.as_ref().unwrap_or(end);
            let gap_s = start.time_s - end.time_s;
            if gap_s <= 0.0 || gap_s > HIDDEN_S {
                continue;
            }
            let gain = gain(end, start, gap_s, arrivals.rate(&starts, i, j));
            if gain > 0.0 {
                gains.push((i, j, gain));
            }
        }
    }
    let mut next = choose(tracklets.len(), &gains);
    if cut {
        // The likelihoods are simple models. `join.rs` calibrates their odds.
        for (end, link) in ends.iter().zip(&mut next) {
            let is_probable =
                |&(j, odds): &(usize, f64)| probability(features(odds, starts[j].time_s - end.time_s)) >= 0.5;
            *link = link.filter(is_probable);
        }
    }
    chains(tracklets, &next)
}

/// Returns the earlier tracklet's detections before the later one begins, if it takes over a vehicle that has two boxes
/// for a while. Then it begins near the end of the earlier one, and their boxes touch. `None` without such an overlap.
fn before_takeover<'a>(earlier: &'a RawTrack, later: &RawTrack) -> Option<&'a [Sighting]> {
    let (all, new) = (&earlier.observations, &later.observations);
    let (first, last) = (new.first()?, all.last()?);
    let outlasts = first.frame <= last.frame && last.frame < new.last()?.frame;
    if !outlasts || last.time_s - first.time_s > MOTION_S || earlier.is_boxed || later.is_boxed {
        return None;
    }
    let (before, tail) = all.split_at(all.partition_point(|seen| seen.frame < first.frame));
    let touches = |seen: &Sighting| {
        let other = &new[new.binary_search_by_key(&seen.frame, |other| other.frame).ok()?];
        Some(bbox_iou(&seen.detection.bbox_px, &other.detection.bbox_px) > 0.0)
    };
    let touching: Vec<bool> = tail.iter().filter_map(touches).collect();
    let most_touch = 2 * touching.iter().filter(|touches| **touches).count() > touching.len();
    (!before.is_empty() && most_touch).then_some(before)
}

/// The driving vehicles that appear where tracklets begin.
struct Arrivals {
    /// Number of other vehicles per m² that appear where each tracklet begins.
    near: Vec<f64>,
    /// Duration of the clip, with one mean time of a stationary vehicle more, s. A short clip does not show how often
    /// vehicles appear.
    seconds: f64,
}

impl Arrivals {
    /// Counts the vehicles.
    fn new(starts: &[End], ends: &[End]) -> Self {
        let first_s = starts.iter().map(|start| start.time_s).fold(f64::INFINITY, f64::min);
        let last_s = ends.iter().map(|end| end.time_s).fold(f64::NEG_INFINITY, f64::max);
        let near = |(j, at): (usize, &End)| {
            let others = starts.iter().enumerate().filter(|(k, _)| *k != j);
            others.map(|(_, other)| Self::near(other, at)).sum()
        };
        let near = starts.iter().enumerate().map(near).collect();
        Self { near, seconds: (last_s - first_s).max(0.0) + STANDS_S }
    }

    /// Returns the density of a driving vehicle that appears where another tracklet begins, per m².
    fn near(start: &End, at: &End) -> f64 {
        let spread =
            start.place_covariance() + at.place_covariance() + Matrix2::identity() * HALF_LANE_M.powi(2);
        (1.0 - start.stands) * density(&(start.place() - at.place()), &spread)
    }

    /// Returns the rate at which other vehicles than those of tracklets `i` and `j` appear where `j` begins, per m² and
    /// s.
    fn rate(&self, starts: &[End], i: usize, j: usize) -> f64 {
        (self.near[j] - Self::near(&starts[i], &starts[j])).max(0.0) / self.seconds
    }
}

/// Returns, for each tracklet, the one that continues it, with the log odds of the join. `gains` holds (earlier, later,
/// gain).
fn choose(count: usize, gains: &[(usize, usize, f64)]) -> Vec<Option<(usize, f64)>> {
    // Nodes 0 … count − 1 are the ends, and the beginnings follow.
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
        let gains: BTreeMap<(usize, usize), f64> = pairs.iter().map(|&(i, j, gain)| ((i, j), gain)).collect();
        let cost = |r: usize, c: usize| gains.get(&(rows[r], columns[c])).map_or(f64::INFINITY, |gain| -gain);
        for (row, column) in assign(rows.len(), columns.len(), 0.0, cost).into_iter().enumerate() {
            let column = column.map(|c| columns[c]).filter(|c| *c != rows[row]);
            next[rows[row]] = column.map(|c| (c, log_odds(rows[row], c, pairs)));
        }
    }
    next
}

/// Returns the log odds that tracklet `later` continues tracklet `earlier` (`join.rs`). `pairs` has all pairs of their
/// group.
fn log_odds(earlier: usize, later: usize, pairs: &[(usize, usize, f64)]) -> f64 {
    let (mut own, mut others) = (f64::NEG_INFINITY, vec![0.0]);
    for &(i, j, gain) in pairs {
        match (i == earlier, j == later) {
            (true, true) => own = gain,
            (true, false) | (false, true) => others.push(gain),
            (false, false) => {}
        }
    }
    let most = others.iter().copied().fold(0.0, f64::max);
    own - most - others.iter().map(|gain| (gain - most).exp()).sum::<f64>().ln()
}

/// Returns the representative of a node's group (union-find), and shortens the path to it.
fn root(groups: &mut [usize], mut of: usize) -> usize {
    while groups[of] != of {
        groups[of] = groups[groups[of]];
        of = groups[of];
    }
    of
}

/// Joins each chain of continuations into one track.
fn chains(tracklets: Vec<RawTrack>, next: &[Option<(usize, f64)>]) -> Vec<RawTrack> {
    let mut begins = vec![true; tracklets.len()];
    next.iter().flatten().for_each(|&(j, _)| begins[j] = false);
    let mut left: Vec<Option<RawTrack>> = tracklets.into_iter().map(Some).collect();
    let mut joined = Vec::new();
    for first in (0..left.len()).filter(|&i| begins[i]) {
        let Some(mut track) = left[first].take() else { continue };
        let mut at = first;
        while let Some((then, log_odds)) = next[at] {
            let Some(later) = left[then].take() else { break };
            let begins = later.observations.first().map_or(usize::MAX, |first| first.frame);
            // A tracklet that takes over begins before the earlier one ends.
            track.observations.retain(|seen| seen.frame < begins);
            track.links.push(Link { frame: begins, log_odds });
            track.append(later);
            at = then;
        }
        joined.push(track);
    }
    joined
}

/// The beginning or the end of a tracklet.
struct End {
    /// Time of the beginning or end, s.
    time_s: f64,
    /// Position and velocity (x, y, vx, vy) on the ground, m and m/s.
    state: Vector4<f64>,
    /// Covariance of `state`, m and m/s.
    covariance: Matrix4<f64>,
    /// Heading modulo π, rad.
    axis: f64,
    /// Probability that the vehicle is stationary, 0–1.
    stands: f64,
    /// Density of its velocity among stationary vehicles, (m/s)⁻².
    standing: f64,
    /// Density of its velocity among driving vehicles, (m/s)⁻².
    driving: f64,
    /// Logarithm of the vehicle's size: diagonal of the box (px) times the distance (m).
    log_size: f64,
    /// Mean colour; `None` where none was measured.
    colour: Option<Colour>,
    /// Votes for each class.
    votes: Votes,
}

impl End {
    /// Computes the beginning of a track, or with `last` its end. `all` are its detections.
    fn of(track: &RawTrack, all: &[Sighting], last: bool) -> Self {
        let edge = if last { &all[all.len() - 1] } else { &all[0] };
        let near = |o: &&Sighting| (o.time_s - edge.time_s).abs() <= MOTION_S;
        let part: Vec<&Sighting> = all.iter().filter(near).collect();
        let (state, covariance) = motion(&part, edge.time_s);
        let mut axis = Vector2::zeros();
        for o in &part {
            let weight = 1.0 / (o.covariance[(2, 2)] + 1e-3);
            axis += Vector2::new((2.0 * o.pose.z).cos(), (2.0 * o.pose.z).sin()) * weight;
        }
        let velocity = state.fixed_rows::<2>(2).into_owned();
        let spread = covariance.fixed_view::<2, 2>(2, 2).into_owned();
        let [standing, driving] = [STANDING_MPS, SPEED_SD]
            .map(|sd| density(&velocity, &(spread + Matrix2::identity() * sd.powi(2))));
        let log_size = |o: &Sighting| {
            let [x0, y0, x1, y1] = o.detection.bbox_px;
            ((x1 - x0).hypot(y1 - y0) * o.pose.xy().norm().max(1.0)).ln()
        };
        let stands = STANDING_SHARE * standing / mixed(standing, driving).max(1e-300);
        let mut sizes: Vec<f64> = part.iter().map(|o| log_size(o)).collect();
        Self {
            time_s: edge.time_s,
            state,
            covariance,
            axis: axis.y.atan2(axis.x) / 2.0,
            stands: if edge.detection.held { 1.0 } else { stands },
            standing,
            driving,
            log_size: upper_median(&mut sizes, f64::total_cmp).unwrap_or_default(),
            colour: Colour::mean(part.iter().copied()),
            votes: track.votes,
        }
    }

    /// Returns the position (x, y), m.
    fn place(&self) -> Vector2<f64> {
        self.state.fixed_rows::<2>(0).into_owned()
    }

    /// Returns the velocity (vx, vy), m/s.
    fn velocity(&self) -> Vector2<f64> {
        self.state.fixed_rows::<2>(2).into_owned()
    }

    /// Returns the covariance of the position, m².
    fn place_covariance(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(0, 0).into_owned()
    }

    /// Returns the covariance of the velocity, (m/s)².
    fn velocity_covariance(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(2, 2).into_owned()
    }
}

/// Estimates position and velocity at a time (s), and their covariance, by a straight line through detections. The
/// noise of a detection is the part of its variance that its neighbours do not share.
fn motion(part: &[&Sighting], time_s: f64) -> (Vector4<f64>, Matrix4<f64>) {
    let mut information = Matrix4::zeros();
    information.fixed_view_mut::<2, 2>(2, 2).fill_diagonal((1.5 * SPEED_SD).powi(-2));
    let mut weighted = Vector4::zeros();
    let mut shared = Matrix2::zeros();
    for o in part {
        let covariance = o.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        shared += covariance * (COMMON_SHARE / part.len() as f64);
        let Some(precision) = (covariance * (1.0 - COMMON_SHARE)).try_inverse() else { continue };
        let dt = o.time_s - time_s;
        information += Matrix2::new(1.0, dt, dt, dt * dt).kronecker(&precision);
        weighted += Vector2::new(1.0, dt).kronecker(&(precision * o.pose.xy()));
    }
    let inverse = information.try_inverse().unwrap_or_else(Matrix4::identity);
    let mut covariance = (inverse + inverse.transpose()) / 2.0;
    covariance.fixed_view_mut::<2, 2>(0, 0).add_assign(&shared);
    (inverse * weighted, covariance)
}

/// Returns the density of a 2-D Gaussian with mean 0 at `x`.
fn density(x: &Vector2<f64>, covariance: &Matrix2<f64>) -> f64 {
    let Some(inverse) = covariance.try_inverse() else { return 0.0 };
    (-0.5 * x.dot(&(inverse * x))).exp() / (2.0 * PI * covariance.determinant().max(1e-300).sqrt())
}

/// Returns the log likelihood ratio of one vehicle against two, for a gap in s. Other vehicles appear at the rate
/// `arrivals` where the gap ends, per m² and s.
fn gain(end: &End, start: &End, gap_s: f64, arrivals: f64) -> f64 {
    let way = start.place() - end.place();
    let places = end.place_covariance() + start.place_covariance();
    // Each mode has its mean time of staying undetected. In this time, the other vehicles appear.
    let mode = |mean_s: f64, density: f64| (-gap_s / mean_s).exp() * density / (APPEARS + arrivals * mean_s);
    let rested = places + Matrix2::identity() * STILL_M.powi(2);
    let stood = mode(STANDS_S, end.stands * density(&way, &rested) * start.standing);
    let drove = mode(DRIVES_S, drive_density(end, start, gap_s));
    let crept = mode(STANDS_S, creep_density(end, start, &way, &places, gap_s));
    let same = SHARES[0] * stood + SHARES[1] * drove + SHARES[2] * crept;
    let new = mixed(start.standing, start.driving);
    let colours = end.colour.zip(start.colour).map_or(0.0, |(before, after)| before.same_vehicle(after));
    (same.max(1e-300) / new.max(1e-300)).ln() + class_gain(end, start) + size_gain(end, start) + colours
}

/// Returns the density of position and velocity after a gap (s) in which the vehicle drove on.
fn drive_density(end: &End, start: &End, gap_s: f64) -> f64 {
    let (state, covariance) = driven(&end.state, &end.covariance, gap_s);
    let spread = covariance + start.covariance + Matrix4::identity() * 0.01;
    let away = start.state - state;
    let Some(factor) = spread.cholesky() else { return 0.0 };
    let root: f64 = factor.l().diagonal().iter().product();
    (-0.5 * away.dot(&factor.solve(&away))).exp() / ((2.0 * PI).powi(2) * root.max(1e-300))
}

/// Returns the density of position and velocity after a gap (s) of stop and go behind an object. The vehicle covers any
/// distance that creeping allows, along the line of its axis.
fn creep_density(end: &End, start: &End, way: &Vector2<f64>, places: &Matrix2<f64>, gap_s: f64) -> f64 {
    let slow = (-0.5 * (end.velocity().norm() / CREEP_MPS).powi(2)).exp();
    let axis = end.axis + fold_axis(start.axis - end.axis) / 2.0;
    let (sin, cos) = axis.sin_cos();
    let (ahead, aside) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
    // The axis may point backwards. The motion before and after shows the true direction.
    let sign = (end.velocity() + start.velocity()).dot(&ahead);
    let along = way.dot(&ahead) * if sign < 0.0 { -1.0 } else { 1.0 };
    let sd = |direction: &Vector2<f64>| direction.dot(&(places * direction)).max(0.0);
    let reach = CREEP_MPS * gap_s;
    let beyond = if along < 0.0 { along } else { (along - reach).max(0.0) };
    let outside = (-0.5 * beyond * beyond / (sd(&ahead) + 0.25)).exp();
    let off = way.dot(&aside);
    let variance = sd(&aside) + STILL_M * STILL_M;
    let on_line = (-0.5 * off * off / variance).exp() / (2.0 * PI * variance).sqrt();
    let after = density(
        &start.velocity(),
        &(start.velocity_covariance() + Matrix2::identity() * (CREEP_MPS / 2.0).powi(2)),
    );
    slow * outside * on_line / (reach + 1.0) * after
}

/// Returns the log likelihood ratio of the class votes: both tracks are one vehicle, or two unrelated vehicles. It is
/// at most 0, and 0 if one of them has no votes.
fn class_gain(end: &End, start: &End) -> f64 {
    if end.votes.sum() <= 0.0 || start.votes.sum() <= 0.0 {
        return 0.0;
    }
    let shares = |votes: &Votes| (votes + PRIOR_VOTES) / (votes + PRIOR_VOTES).sum();
    let same = shares(&end.votes).dot(&shares(&start.votes));
    // Most vehicles are of one class, so agreement says little and disagreement much.
    (same / 0.6).ln().min(0.0)
}

/// Returns the log likelihood ratio of the sizes, at most 0.
fn size_gain(end: &End, start: &End) -> f64 {
    -0.5 * ((start.log_size - end.log_size) / SIZE_SD).powi(2)
}
