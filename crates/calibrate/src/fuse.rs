//! Fuses the estimates of windows to the camera over time.
//!
//! Each window gives a Gaussian `c ~ N(c_w, I_w⁻¹)` of c = (log f, tilt, roll, log h). All information in `I_w` comes
//! from keypoints, none from a prior. The window also gives the dependence of c on the errors that all cars of the site
//! share.
//!
//! Windows share parked cars, and so they share the bias of these cars' keypoints. Therefore window w counts with the
//! factor
//!
//! ```text
//! q_w = mean over its cars k of  1 / (1 + (n_k − 1) γ_k)
//! ```
//!
//! Here n_k is the number of windows with car k in this interval. The correlation between the evidence of car k in two
//! windows is γ_k, about 1 for a parked car. A clip of one parked row gives the same sd with one window or with a
//! hundred.

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

/// A car that was used in a window's estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CarUse {
    /// Identifier of the car.
    pub link: LinkId,
    /// Whether the car was stationary.
    pub parked: bool,
}

/// Result of the joint solve of a window.
#[derive(Clone, Debug)]
pub struct WindowEstimate {
    /// First and last presentation time of the window, s.
    pub span_s: [f64; 2],
    /// Number of frames in the window.
    pub frames: usize,
    /// Focal length, tilt, roll and height from the keypoints alone.
    pub params: CameraParams,
    /// Result of the solve with all its priors and factors.
    pub solved: CameraParams,
    /// Evidence of the keypoints on the camera and on the errors that the site's cars share, without a camera prior.
    ///
    /// It may be singular. Without the shared errors its mean is `params`.
    pub joint: JointInformation,
    /// Cars that were used.
    pub cars: Vec<CarUse>,
    /// Index of the camera position, from 0, as in [`Window`](crate::Window).
    pub segment: usize,
    /// How that camera position began, as in [`Window`](crate::Window).
    pub start: SegmentStart,
    /// Whether the camera did not move since the previous window, as in [`Window`](crate::Window).
    pub steady: bool,
}

impl WindowEstimate {
    /// Returns the information on `params` as if there were no shared errors.
    #[must_use]
    pub fn information(&self) -> Matrix4<f64> {
        self.joint.information
    }
}

/// Options for joining windows.
#[derive(Clone, Debug)]
pub struct FuseOptions {
    /// Size of the pictures; copied to the result.
    pub image_size_px: ImageSize,
    /// Principal point, px; copied to the result.
    pub principal_point_px: Vector2<f64>,
    /// Whether the user gave the focal length; the prior then contains it.
    pub focal_given: bool,
    /// Prior of the camera; it is counted once.
    pub prior: FusePrior,
    /// Drift of a mounted camera: sds of log focal length, tilt, roll and log height after 1 s. They grow with the root
    /// of time.
    pub drift_sd: Vector4<f64>,
    /// Correlation between the evidence of a parked car in two windows.
    pub parked_correlation: f64,
    /// Correlation between the evidence of a car in two windows if the car moved between them.
    pub moving_correlation: f64,
    /// Sds of the errors that all cars of the site share, and so all windows. The scatter of windows does not show
    /// them.
    pub shared_sd: SharedSd,
    /// Lens distortion with which the windows were solved.
    pub lens: Lens,
    /// Sd of the distortion ([`Lens::distortion`]); `None` where neither the picture nor the user determines it.
    pub bend_sd: Option<f64>,
    /// Other factors on the camera, by camera position ([`WindowEstimate::segment`]). Each factor is counted once.
    ///
    /// A number that a camera move does not change is counted at the first position for which it holds.
    pub factors: BTreeMap<usize, Arc<[Factor]>>,
    /// Sd of the log size of the site's cars relative to the atlas.
    ///
    /// All windows share this error of scale. Factors in metres determine it.
    pub size_of_cars_sd: f64,
    /// Least gain in log likelihood for which a change or a drift of the camera is accepted.
    pub min_gain: f64,
}

impl FuseOptions {
    /// Returns the options without factors, for the camera from cars alone, in units of the atlas's cars.
    #[must_use]
    pub fn for_cars(&self) -> Self {
        Self { factors: BTreeMap::new(), size_of_cars_sd: 0.0, ..self.clone() }
    }

    /// Returns the defaults for pictures of this size: the default [`CameraPrior`], the principal point in the middle.
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

/// Error model of windows; a window with a wrong minimum has little weight.
const SCATTER: StudentT = StudentT { dimensions: 4.0 };
/// Least log zoom between two camera positions for which the focal length counts as changed.
const ZOOM: f64 = 0.03;
/// Multiples of `drift_sd` that are tried.
const DRIFTS: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// Fuses the windows of a clip, in the order of time.
///
/// A stationary camera gives one estimate. A camera that was moved gives one per position, and a drifting camera one
/// per window. Without windows with finite numbers there is no estimate.
#[must_use]
pub fn fuse(windows: &[WindowEstimate], options: &FuseOptions) -> Vec<CameraEstimate> {
    join(windows, options).estimates
}

/// Result of joining windows.
#[derive(Clone, Debug)]
pub struct Joined {
    /// Estimates of the camera, in the order of positions and then of time.
    pub estimates: Vec<CameraEstimate>,
    /// Index of the camera position of each estimate.
    pub segments: Vec<usize>,
    /// Log of the size of the site's cars relative to the atlas; 0 where only cars determine the scale.
    pub size_of_cars: f64,
}

/// Fuses the windows of a clip like [`fuse`], and also returns the size of the cars.
#[must_use]
pub fn join(windows: &[WindowEstimate], options: &FuseOptions) -> Joined {
    let mut usable: Vec<&WindowEstimate> = windows.iter().filter(|w| is_usable(w)).collect();
    // Windows of a position to which the camera returns come together.
    usable.sort_by(|a, b| a.segment.cmp(&b.segment).then(a.span_s[0].total_cmp(&b.span_s[0])));
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
                    // Only the estimates show this change, so the focal length may have changed too.
                    (None, _) => Step::fresh(),
                };
                let shares = if pieces.len() == 1 { &shares[..] } else { &shares[i..=i] };
                nodes.push((piece.to_vec(), node(piece, shares, step, options)));
            }
        }
    }
    let (groups, nodes): (Vec<_>, Vec<_>) = nodes.into_iter().unzip();
    let (nodes, states) = with_clues(&groups, nodes, options);
    let segments = groups.iter().map(|group| group.first().map_or(0, |window| window.segment)).collect();
    let pieces = groups.iter().zip(&nodes).zip(&states);
    Joined {
        segments,
        estimates: pieces.map(|((group, node), state)| estimate(group, node, state, options)).collect(),
        size_of_cars: states.last().map_or(0.0, Gaussian::size_of_cars),
    }
}

/// Largest number of rounds of linearising the factors and smoothing. Factors are no Gaussians, so each round
/// linearises them at the last estimate.
const CLUE_ROUNDS: usize = 10;

/// Returns the nodes with their factors, and the smoothed states. The factors of a position belong to its first piece.
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
    // The windows were solved with the factors, so their solutions are near the joint one.
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

/// Returns (log f, tilt, roll, log h) twice: in the scale of the atlas's cars, and in metres.
fn both_scales(state: &Gaussian) -> [Vector4<f64>; 2] {
    [state.by_cars(), state.camera().0]
}

/// Returns whether a window has finite numbers and no negative information.
fn is_usable(window: &WindowEstimate) -> bool {
    let finite = window.params.to_vector().iter().chain(window.joint.vector.iter()).all(|x| x.is_finite())
        && window.joint.information.iter().chain(window.joint.cross.iter()).all(|x| x.is_finite());
    finite && window.span_s.iter().all(|t| t.is_finite()) && window.joint.information.diagonal().min() >= 0.0
}

/// Returns the mean of the windows' middle times, s.
fn middle_s(windows: &[&WindowEstimate]) -> f64 {
    windows.iter().map(|w| w.span_s[0] + w.span_s[1]).sum::<f64>() / (2 * windows.len().max(1)) as f64
}

/// Returns the transition of the camera that a new camera position implies.
fn step_from(start: SegmentStart) -> Step {
    match start {
        // The mount stays, so height and focal length nearly keep their values. The directions are new.
        SegmentStart::Moved { log_scale } if log_scale.abs() <= ZOOM => {
            Step { kept: Vector4::new(1.0, 0.0, 0.0, 1.0), variance: Vector4::new(1e-3, 0.0, 0.0, 4e-3) }
        }
        SegmentStart::Moved { .. } => {
            Step { kept: Vector4::new(0.0, 0.0, 0.0, 1.0), variance: Vector4::new(0.0, 0.0, 0.0, 4e-3) }
        }
        SegmentStart::Clip | SegmentStart::Cut => Step::fresh(),
    }
}

/// Returns the share of each window's evidence that other windows of the group do not already contain, 0–1.
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

/// A robust fit of one constant camera to a group of windows.
struct Constant {
    /// Student-t weight of each window.
    weights: Vec<f64>,
    /// Squared Mahalanobis distance of each window from the constant.
    distances: Vec<f64>,
    /// Cost `Σ (ν + 4) ln(1 + d²/ν) / 2` over the windows.
    cost: f64,
}

/// Fits one constant camera to a group. `shares` are the windows' shares of new evidence, 0–1.
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

/// A group of windows in which the camera was either stationary or drifting.
struct Part<'a, 'w> {
    /// The windows, in the order of time.
    windows: &'a [&'w WindowEstimate],
    /// Drift as a multiple of `drift_sd`; `None` for a stationary camera.
    drift: Option<f64>,
}

/// Condenses several windows of one camera position to one. `None` without usable windows.
#[must_use]
pub fn condense(windows: &[WindowEstimate], options: &FuseOptions) -> Option<WindowEstimate> {
    let usable: Vec<&WindowEstimate> = windows.iter().filter(|w| is_usable(w)).collect();
    let first = *usable.first()?;
    let joint = together(&usable, &shares(&usable, options), options);
    // A very weak prior keeps the numbers finite where the windows have no information. The result's information
    // excludes it.
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

/// Finds the best explanation of a group: a stationary camera, a drift, or a sudden change with an explanation of each
/// side.
///
/// Returns the parts and their gain in log likelihood. Each change or drift must gain at least `min_gain`. No change is
/// accepted where parked cars confirm a stationary camera. One window alone is no change: the next one must agree.
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

/// Returns the multiple of `drift_sd` that explains a group best, and its gain in log likelihood over no drift.
fn drift_of(group: &[&WindowEstimate], options: &FuseOptions) -> (f64, f64) {
    let still = drift_log_likelihood(group, 0.0, options);
    let gains = DRIFTS.map(|scale| (scale, drift_log_likelihood(group, scale, options) - still));
    gains.into_iter().fold((0.0, 0.0), |best, next| if next.1 > best.1 { next } else { best })
}

/// Returns the log likelihood of the windows' innovations in a random walk with Student-t tails.
///
/// `scale` is the drift as a multiple of `drift_sd`.
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
        // Numbers without evidence in the window get a large, but finite, variance.
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

/// Builds the node of a group of windows under one constant camera.
fn node(group: &[&WindowEstimate], shares: &[f64], step: Step, options: &FuseOptions) -> Node {
    let (information, weighted) = together(group, shares, options).marginal(options.shared_sd);
    Node { cars: Evidence { information, weighted }, metres: Evidence::none(), step }
}

/// Returns the joint evidence of a group under one constant camera.
///
/// If windows scatter more than their covariances allow, the covariance is widened (Birge's ratio).
fn together(group: &[&WindowEstimate], shares: &[f64], options: &FuseOptions) -> JointInformation {
    let Constant { weights, distances, .. } = constant(group, shares, options);
    let surplus = 4.0 * (group.len() as f64 - 1.0);
    let scatter: f64 = distances.iter().zip(&weights).map(|(d2, w)| d2 * w).sum();
    let widened = if group.len() >= 3 { (scatter / surplus).max(1.0) } else { 1.0 };
    let mut sum = JointInformation::none();
    for ((window, share), weight) in group.iter().zip(shares).zip(&weights) {
        // A weight above 1 would claim more information than the window has.
        sum.add(&window.joint, share * weight.min(1.0) / widened);
    }
    sum
}

/// Builds the camera estimate of a group from its smoothed state.
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
        distortion_sd: options.bend_sd,
        params: CameraParams::from_vector(&params),
        covariance,
        status,
        cars_used: cars.len(),
        frames_used: group.iter().map(|w| w.frames).sum(),
    }
}
