//! Estimates of windows → camera over time.
//!
//! Each window says `c ~ N(c_w, I_w⁻¹)` of c = (log f, tilt, roll, log h), all information in `I_w` from keypoints, none from
//! a prior, and how it depends on the errors that all cars of the place share. Windows share parked cars, whose keypoint bias they
//! share as well. So window w counts with the factor
//!
//! ```text
//! q_w = mean over its cars k of  1 / (1 + (n_k − 1) γ_k)
//! ```
//!
//! n_k = windows of this stretch that use car k, γ = correlation of what k says in two windows (about 1 for a parked car).
//! A clip of one parked row gives the same sd whether it is cut into one window or a hundred.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{
    CameraEstimate, CameraParams, CameraPrior, CameraStatus, Factor, ImageSize, JointInformation, Lens,
    SHARED_ERRORS, SharedSd, StudentT, is_determined, weighted_median,
};

use crate::nodes::{Evidence, Gaussian, Node, Step, smooth};
use crate::prior::FusePrior;
use crate::{LinkId, SegmentStart};

/// A car that a window's estimate rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CarUse {
    /// Which car.
    pub link: LinkId,
    /// It stood still.
    pub parked: bool,
}

/// What the joint solve of a window found.
#[derive(Clone, Debug)]
pub struct WindowEstimate {
    /// First and last presentation time, s.
    pub span_s: [f64; 2],
    /// Frames in the window.
    pub frames: usize,
    /// Focal length, tilt, roll, height, by the keypoints alone.
    pub params: CameraParams,
    /// The solve's own answer, with all that it was told besides.
    pub solved: CameraParams,
    /// What the keypoints say, of the errors too that the place's cars share, without any prior on the camera; may be singular.
    /// Without such errors it leads to `params`.
    pub joint: JointInformation,
    /// Cars that it rests on.
    pub cars: Vec<CarUse>,
    /// As in [`Window`](crate::Window).
    pub segment: usize,
    /// As in [`Window`](crate::Window).
    pub start: SegmentStart,
    /// As in [`Window`](crate::Window).
    pub steady: bool,
}

impl WindowEstimate {
    /// Information on `params`, were there no shared errors.
    #[must_use]
    pub fn information(&self) -> Matrix4<f64> {
        self.joint.information
    }
}

/// How windows are joined.
#[derive(Clone, Debug)]
pub struct FuseOptions {
    /// Size of the pictures, for the result.
    pub image_size_px: ImageSize,
    /// Principal point, px, for the result.
    pub principal_point_px: Vector2<f64>,
    /// The focal length is known and the prior holds it.
    pub focal_given: bool,
    /// The prior; it is counted once.
    pub prior: FusePrior,
    /// Drift of a mounted camera: sd of log focal, tilt, roll, log height after 1 s, growing with the root of time.
    pub drift_sd: Vector4<f64>,
    /// Correlation of what a parked car says in two windows.
    pub parked_correlation: f64,
    /// The same for a car that moved between them.
    pub moving_correlation: f64,
    /// sd of the errors that all cars of the place share, and so all windows: it does not show in how they scatter.
    pub shared_sd: SharedSd,
    /// How the lens bends lines: the windows were solved with it.
    pub lens: Lens,
    /// sd of its bend where the picture, or somebody, told it.
    pub bend_sd: Option<f64>,
    /// What else speaks of the camera, by its position ([`WindowEstimate::segment`]); counted once. A number that a move keeps is
    /// counted at the first of the positions that it holds for.
    pub factors: BTreeMap<usize, Arc<[Factor]>>,
    /// sd of how large the place's cars are against the atlas, log: all windows share that error of scale. Clues in metres tell it.
    pub size_of_cars_sd: f64,
    /// Gain in log likelihood that a change of the camera, or a drift, must bring to be believed.
    pub min_gain: f64,
}

impl FuseOptions {
    /// The same for what cars alone say, in units of the atlas' cars.
    #[must_use]
    pub fn for_cars(&self) -> Self {
        Self { factors: BTreeMap::new(), size_of_cars_sd: 0.0, ..self.clone() }
    }

    /// For pictures of this size: the default [`CameraPrior`], principal point in the middle.
    #[must_use]
    pub fn for_image(image_size_px: ImageSize) -> Self {
        let prior = CameraPrior::default();
        Self {
            image_size_px,
            principal_point_px: image_size_px.centre_px(),
            focal_given: false,
            prior: FusePrior { params: prior.mean(image_size_px), sd: prior.sd() },
            drift_sd: Vector4::new(1e-4, 5e-5, 5e-5, 1e-4),
            parked_correlation: 1.0,
            moving_correlation: 0.3,
            shared_sd: [0.0; SHARED_ERRORS],
            lens: Lens::STRAIGHT,
            bend_sd: None,
            factors: BTreeMap::new(),
            size_of_cars_sd: 0.0,
            min_gain: 16.0,
        }
    }
}

/// How windows are taken to scatter: one with a wrong minimum counts little.
const SCATTER: StudentT = StudentT { dimensions: 4.0 };
/// A zoom of more than this between two camera positions says that the focal length changed, log.
const ZOOM: f64 = 0.03;
/// Multiples of `drift_sd` that are tried.
const DRIFTS: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// Joins the windows of a clip, in the order of time. A camera that stayed put gives one estimate, one that was moved an
/// estimate per position, one that drifts an estimate per window. No windows, or none with finite numbers, give none.
#[must_use]
pub fn fuse(windows: &[WindowEstimate], options: &FuseOptions) -> Vec<CameraEstimate> {
    join(windows, options).estimates
}

/// What windows come to.
#[derive(Clone, Debug)]
pub struct Joined {
    /// The camera over time.
    pub estimates: Vec<CameraEstimate>,
    /// Log of how large the place's cars are against the atlas; 0 where nothing but cars tells scale.
    pub size_of_cars: f64,
}

/// The same as [`fuse`], with what it tells of the cars.
#[must_use]
pub fn join(windows: &[WindowEstimate], options: &FuseOptions) -> Joined {
    let mut usable: Vec<&WindowEstimate> = windows.iter().filter(|w| is_usable(w)).collect();
    usable.sort_by(|a, b| a.span_s[0].total_cmp(&b.span_s[0]));
    let mut nodes = Vec::new();
    for segment in usable.chunk_by(|a, b| a.segment == b.segment) {
        let mut start = Some(segment[0].start);
        for Part { windows: part, drift } in explain(segment, options).0 {
            let pieces: Vec<&[&WindowEstimate]> =
                if drift.is_some() { part.chunks(1).collect() } else { vec![part] };
            let shares = shares(part, options);
            for (i, piece) in pieces.iter().enumerate() {
                let step = match (start.take(), drift) {
                    (Some(start), _) => step_from(start),
                    (None, Some(scale)) if i > 0 => {
                        let gap_s = (middle_s(piece) - middle_s(pieces[i - 1])).max(0.0);
                        Step::kept((options.drift_sd * scale).map(|sd| sd * sd * gap_s))
                    }
                    // A change that only the estimates show: nothing says that the focal length stayed.
                    (None, _) => Step::fresh(),
                };
                let shares = if pieces.len() == 1 { &shares[..] } else { &shares[i..=i] };
                nodes.push((piece.to_vec(), node(piece, shares, step, options)));
            }
        }
    }
    let (groups, nodes): (Vec<_>, Vec<_>) = nodes.into_iter().unzip();
    let (nodes, states) = with_clues(&groups, nodes, options);
    let pieces = groups.iter().zip(&nodes).zip(&states);
    Joined {
        estimates: pieces.map(|((group, node), state)| estimate(group, node, state, options)).collect(),
        size_of_cars: states.last().map_or(0.0, Gaussian::size_of_cars),
    }
}

/// Rounds of following the factors, which are no Gaussians: linearised at the estimate, smoothed, linearised there.
const CLUE_ROUNDS: usize = 10;

/// The states at all nodes, factors counted, and the nodes with them: each position's in its first piece.
fn with_clues(
    groups: &[Vec<&WindowEstimate>],
    cars: Vec<Node>,
    options: &FuseOptions,
) -> (Vec<Node>, Vec<Gaussian>) {
    let mut states = smooth(&cars, &options.prior, options.size_of_cars_sd);
    let segment = |i: usize| groups[i].first().map(|window| window.segment);
    let clues_of = |i: usize| {
        let factors = options.factors.get(&segment(i)?).filter(|_| i == 0 || segment(i - 1) != segment(i))?;
        let kept = cars[i].step.kept;
        let told =
            |factor: &&Factor| matches!(factor, Factor::Number { which, .. } if i > 0 && kept[*which] > 0.0);
        Some((i, factors.iter().filter(|factor| !told(factor)).collect::<Vec<_>>()))
    };
    let factors: Vec<(usize, Vec<&Factor>)> = (0..groups.len()).filter_map(clues_of).collect();
    // The windows were solved with the factors, and know where they lead.
    let mut at: Vec<[Vector4<f64>; 2]> = states.iter().map(both_scales).collect();
    for (i, _) in &factors {
        at[*i] = groups[*i].last().map_or(at[*i], |window| [window.solved.to_vector(); 2]);
    }
    let mut told: Vec<Vec<Evidence>> =
        factors.iter().map(|(_, factors)| vec![Evidence::none(); factors.len()]).collect();
    let mut nodes = cars.clone();
    for _ in 0..CLUE_ROUNDS {
        for ((i, factors), told) in factors.iter().zip(&mut told) {
            let [by_cars, in_metres] = at[*i];
            let known = states[*i].evidence();
            nodes[*i] = cars[*i].clone();
            for (factor, told) in factors.iter().zip(told) {
                let node = &mut nodes[*i];
                if factor.is_by_cars() {
                    *told = Evidence::of_factor(factor, &by_cars, None);
                    node.cars = node.cars.and(told);
                } else {
                    *told = Evidence::of_factor(
                        factor,
                        &in_metres,
                        known.map(|known| known.without(told)).as_ref(),
                    );
                    node.metres = node.metres.and(told);
                }
            }
        }
        if factors.is_empty() {
            break;
        }
        states = smooth(&nodes, &options.prior, options.size_of_cars_sd);
        let here: Vec<[Vector4<f64>; 2]> = states.iter().map(both_scales).collect();
        let moved = factors.iter().map(|(i, _)| (here[*i][1] - at[*i][1]).amax()).fold(0.0, f64::max);
        at = here;
        if moved < 1e-9 {
            break;
        }
    }
    (nodes, states)
}

/// The camera by the cars' scale, and in metres.
fn both_scales(state: &Gaussian) -> [Vector4<f64>; 2] {
    [state.by_cars(), state.camera().0]
}

fn is_usable(window: &WindowEstimate) -> bool {
    let finite = window.params.to_vector().iter().chain(window.joint.vector.iter()).all(|x| x.is_finite())
        && window.joint.information.iter().chain(window.joint.cross.iter()).all(|x| x.is_finite());
    finite && window.span_s.iter().all(|t| t.is_finite()) && window.joint.information.diagonal().min() >= 0.0
}

fn middle_s(windows: &[&WindowEstimate]) -> f64 {
    windows.iter().map(|w| w.span_s[0] + w.span_s[1]).sum::<f64>() / (2 * windows.len().max(1)) as f64
}

fn step_from(start: SegmentStart) -> Step {
    match start {
        // The mount stays, so height and focal length nearly do; directions are new.
        SegmentStart::Moved { log_scale } if log_scale.abs() <= ZOOM => {
            Step { kept: Vector4::new(1.0, 0.0, 0.0, 1.0), variance: Vector4::new(1e-3, 0.0, 0.0, 4e-3) }
        }
        SegmentStart::Moved { .. } => {
            Step { kept: Vector4::new(0.0, 0.0, 0.0, 1.0), variance: Vector4::new(0.0, 0.0, 0.0, 4e-3) }
        }
        SegmentStart::Clip | SegmentStart::Cut => Step::fresh(),
    }
}

/// Evidence of each window that others of the group do not already bring, 0–1.
fn shares(group: &[&WindowEstimate], options: &FuseOptions) -> Vec<f64> {
    let mut windows_of: BTreeMap<LinkId, f64> = BTreeMap::new();
    for window in group {
        for link in window.cars.iter().map(|car| car.link).collect::<BTreeSet<_>>() {
            *windows_of.entry(link).or_default() += 1.0;
        }
    }
    let share = |window: &&WindowEstimate| {
        let of_car = |car: &CarUse| {
            let correlation =
                if car.parked { options.parked_correlation } else { options.moving_correlation };
            1.0 / (1.0 + (windows_of.get(&car.link).copied().unwrap_or(1.0) - 1.0) * correlation)
        };
        let total: f64 = window.cars.iter().map(of_car).sum();
        if window.cars.is_empty() { 1.0 / group.len() as f64 } else { total / window.cars.len() as f64 }
    };
    group.iter().map(share).collect()
}

/// A robust constant for a group: each window's weight and squared distance, and the cost `Σ (ν + 4) ln(1 + d²/ν) / 2`.
struct Constant {
    weights: Vec<f64>,
    distances: Vec<f64>,
    cost: f64,
}

fn constant(group: &[&WindowEstimate], shares: &[f64], options: &FuseOptions) -> Constant {
    let prior_information = Matrix4::from_diagonal(&options.prior.sd.map(|sd| 1.0 / (sd * sd)));
    let prior = options.prior.params.to_vector();
    let mut centre = Vector4::from_fn(|i, _| {
        let mut values: Vec<(f64, f64)> = group
            .iter()
            .zip(shares)
            .map(|(w, share)| (w.params.to_vector()[i], share * w.joint.information[(i, i)]))
            .collect();
        weighted_median(&mut values).unwrap_or(prior[i])
    });
    let distance = |w: &WindowEstimate, centre: &Vector4<f64>| {
        let away = w.params.to_vector() - centre;
        (away.transpose() * w.information() * away)[0].max(0.0)
    };
    let mut distances = Vec::new();
    let mut weights = Vec::new();
    for _ in 0..30 {
        distances = group.iter().map(|w| distance(w, &centre)).collect();
        weights = distances.iter().map(|d2| SCATTER.weight(*d2)).collect();
        let mut information = prior_information;
        let mut sum = prior_information * prior;
        for ((window, share), weight) in group.iter().zip(shares).zip(&weights) {
            let own = window.information() * (share * weight);
            information += own;
            sum += own * window.params.to_vector();
        }
        let Some(next) = information.cholesky().map(|c| c.solve(&sum)) else { break };
        let moved = (next - centre).norm();
        centre = next;
        if moved < 1e-12 {
            break;
        }
    }
    let cost = distances.iter().map(|d2| SCATTER.cost(*d2)).sum();
    Constant { weights, distances, cost }
}

/// A group of windows as one thing happened to the camera: it stood, or drifted by a multiple of `drift_sd`.
struct Part<'a, 'w> {
    windows: &'a [&'w WindowEstimate],
    drift: Option<f64>,
}

/// Several windows of one camera position as one: what they say together. `None` without usable windows.
#[must_use]
pub fn condense(windows: &[WindowEstimate], options: &FuseOptions) -> Option<WindowEstimate> {
    let usable: Vec<&WindowEstimate> = windows.iter().filter(|w| is_usable(w)).collect();
    let first = *usable.first()?;
    let joint = together(&usable, &shares(&usable, options), options);
    // Where the windows say nothing, the weakest of priors keeps the numbers finite; it is not in the information.
    let weak = Matrix4::from_diagonal(&options.prior.sd.map(|sd| 1e-6 / (sd * sd)));
    let weighted = joint.vector + weak * options.prior.params.to_vector();
    let params = (joint.information + weak).cholesky()?.solve(&weighted);
    let mut cars: Vec<CarUse> = usable.iter().flat_map(|w| w.cars.iter().copied()).collect();
    cars.sort_by_key(|car| (car.link, !car.parked));
    cars.dedup_by_key(|car| car.link);
    Some(WindowEstimate {
        span_s: [
            usable.iter().map(|w| w.span_s[0]).fold(f64::INFINITY, f64::min),
            usable.iter().map(|w| w.span_s[1]).fold(f64::NEG_INFINITY, f64::max),
        ],
        frames: usable.iter().map(|w| w.frames).sum(),
        params: CameraParams::from_vector(&params),
        solved: CameraParams::from_vector(&params),
        joint,
        cars,
        segment: first.segment,
        start: first.start,
        steady: true,
    })
}

/// What best explains a group: standing, drifting, or a sudden change with what explains either side of it. Each change or
/// drift must pay `min_gain` in log likelihood. No change is seen where parked cars witnessed a steady camera, and none off
/// a single window: the next one must agree.
fn explain<'a, 'w>(group: &'a [&'w WindowEstimate], options: &FuseOptions) -> (Vec<Part<'a, 'w>>, f64) {
    let standing = (vec![Part { windows: group, drift: None }], 0.0);
    if group.len() < 4 || group[1..].iter().all(|w| w.steady) {
        return standing;
    }
    let cost = |part: &[&WindowEstimate]| constant(part, &shares(part, options), options).cost;
    let whole = cost(group);
    let gains = (2..=group.len() - 2)
        .filter(|&cut| !group[cut].steady)
        .map(|cut| (cut, whole - cost(&group[..cut]) - cost(&group[cut..]) - options.min_gain));
    let best = gains.reduce(|best, next| if next.1 > best.1 { next } else { best });
    let changed = best.filter(|(_, gain)| *gain > 0.0).map_or(standing, |(cut, gain)| {
        let (mut parts, before) = explain(&group[..cut], options);
        let (rest, after) = explain(&group[cut..], options);
        parts.extend(rest);
        (parts, gain + before + after)
    });
    let (scale, gain) = drift_of(group, options);
    let drifted = gain - options.min_gain;
    if drifted > changed.1 { (vec![Part { windows: group, drift: Some(scale) }], drifted) } else { changed }
}

/// The multiple of `drift_sd` that explains a group best, and its gain over standing still.
fn drift_of(group: &[&WindowEstimate], options: &FuseOptions) -> (f64, f64) {
    let still = drift_log_likelihood(group, 0.0, options);
    let gains = DRIFTS.map(|scale| (scale, drift_log_likelihood(group, scale, options) - still));
    gains.into_iter().fold((0.0, 0.0), |best, next| if next.1 > best.1 { next } else { best })
}

/// Log likelihood of the windows' innovations in a random walk, with Student-t tails.
fn drift_log_likelihood(group: &[&WindowEstimate], scale: f64, options: &FuseOptions) -> f64 {
    let mut mean = options.prior.params.to_vector();
    let mut covariance = Matrix4::from_diagonal(&options.prior.sd.map(|sd| sd * sd));
    let loose = covariance.map(|v| 1e4 * v);
    let mut total = 0.0;
    for (i, window) in group.iter().enumerate() {
        if i > 0 {
            let gap_s = (middle_s(&group[i..=i]) - middle_s(&group[i - 1..i])).max(0.0);
            covariance += Matrix4::from_diagonal(&(options.drift_sd * scale).map(|sd| sd * sd * gap_s));
        }
        // What a window says nothing of gets a loose, not an infinite, variance.
        let weak = Matrix4::from_diagonal(&loose.diagonal().map(|v| 1.0 / v));
        let Some(noise) = (window.information() + weak).try_inverse() else { continue };
        let innovation = window.params.to_vector() - mean;
        let Some(factor) = (covariance + noise).cholesky() else { continue };
        let d2 = innovation.dot(&factor.solve(&innovation));
        total -= SCATTER.cost(d2) + 0.5 * factor.determinant().ln();
        let Some(factor) = (covariance + noise / SCATTER.weight(d2)).cholesky() else { continue };
        let gain = factor.solve(&covariance).transpose();
        mean += gain * innovation;
        covariance -= gain * covariance;
        covariance = (covariance + covariance.transpose()) / 2.0;
    }
    total
}

/// One piece of evidence: a group under one constant.
fn node(group: &[&WindowEstimate], shares: &[f64], step: Step, options: &FuseOptions) -> Node {
    let (information, weighted) = together(group, shares, options).marginal(options.shared_sd);
    Node { cars: Evidence { information, weighted }, metres: Evidence::none(), step }
}

/// What a group says under one constant. Windows that scatter more than they claim widen it (Birge's ratio).
fn together(group: &[&WindowEstimate], shares: &[f64], options: &FuseOptions) -> JointInformation {
    let Constant { weights, distances, .. } = constant(group, shares, options);
    let surplus = 4.0 * (group.len() as f64 - 1.0);
    let scatter: f64 = distances.iter().zip(&weights).map(|(d2, w)| d2 * w).sum();
    let widened = if group.len() >= 3 { (scatter / surplus).max(1.0) } else { 1.0 };
    let mut sum = JointInformation::none();
    for ((window, share), weight) in group.iter().zip(shares).zip(&weights) {
        // Weights above 1 would claim more than the window does.
        sum.add(&window.joint, share * weight.min(1.0) / widened);
    }
    sum
}

fn estimate(
    group: &[&WindowEstimate],
    node: &Node,
    state: &Gaussian,
    options: &FuseOptions,
) -> CameraEstimate {
    let (params, covariance) = state.camera();
    let told = node.cars.and(&node.metres).information;
    let prior = options.prior.sd.map(|sd| 1.0 / (sd * sd));
    let known = |number: usize| is_determined(number, &told, &prior);
    let status = if !(known(1) && known(3)) {
        CameraStatus::Unobservable
    } else if options.focal_given {
        CameraStatus::FocalGiven
    } else if known(0) {
        CameraStatus::Estimated
    } else {
        CameraStatus::FocalFromPrior
    };
    let cars: BTreeSet<LinkId> = group.iter().flat_map(|w| w.cars.iter().map(|car| car.link)).collect();
    CameraEstimate {
        span_s: [
            group.iter().map(|w| w.span_s[0]).fold(f64::INFINITY, f64::min),
            group.iter().map(|w| w.span_s[1]).fold(f64::NEG_INFINITY, f64::max),
        ],
        image_size_px: options.image_size_px,
        principal_point_px: options.principal_point_px,
        lens: options.lens,
        bend_sd: options.bend_sd,
        params: CameraParams::from_vector(&params),
        covariance,
        status,
        cars_used: cars.len(),
        frames_used: group.iter().map(|w| w.frames).sum(),
    }
}
