//! The factor graph of a clip's camera: fuses the windows and all other factors over time.
//!
//! The unknowns are (log f, tilt, roll, log h) of each camera position, and the size of the site's cars. The evidence
//! is
//!
//! - the cars. Each window gives a Gaussian of (log f, tilt, roll, log h) from their keypoints. The Gaussian depends on
//!   the errors that all cars of the site share. The mean of the windows of a position counts as a Gaussian of (log f,
//!   horizon, roll, log h).
//! - [`Factor`]s: user constraints, verticals, turns. A factor counts once at its camera position.
//! - the focal length that the two planes of a folded ground have in common, and the camera's prior.
//!
//! Some results use a part of the evidence: the camera by cars alone has no factors ([`FuseOptions::for_cars`]).
//!
//! Windows share parked cars, and so they share the bias of these cars' keypoints. Therefore window w counts with the
//! factor
//!
//! ```text
//! q_w = mean over its cars k of  1 / (1 + (n_k − 1) γ_k)
//! ```
//!
//! Here n_k is the number of windows with car k at this position. The correlation between the evidence of car k in two
//! windows is γ_k, about 1 for a parked car. A clip of one parked row gives the same sd with one window or with a
//! hundred.

mod evidence;
mod group;
mod horizon;
mod nodes;
mod options;
mod window;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector4;
use roadplane_base::{CameraEstimate, CameraParams, CameraStatus, is_determined};

use self::evidence::Evidence;
pub(crate) use self::group::VIEW_CORRELATION;
pub use self::group::condense;
use self::group::{is_usable, mean, span_s, together};
use self::horizon::{linearised, of_horizon};
use self::nodes::{Gaussian, Node, smooth};
pub use self::options::{FuseOptions, LEAST_SD};
pub use self::window::{CarIdentity, CarUse, WindowEstimate};
use crate::MOST_ROUNDS;
use crate::factors::Factor;

/// Change of the camera in one round of linearising and smoothing below which the rounds end, log or rad.
const STILL: f64 = 1e-9;

/// Fuses the windows of a clip, in the order of time.
///
/// There is one estimate per camera position. A position without a usable window has no estimate.
#[must_use]
pub fn fuse(windows: &[WindowEstimate], options: &FuseOptions) -> Vec<CameraEstimate> {
    join(windows, options).estimates.into_values().collect()
}

/// Result of joining windows.
#[derive(Clone, Debug)]
pub struct Joined {
    /// Estimate of the camera at each position.
    pub estimates: BTreeMap<usize, CameraEstimate>,
    /// Log of the size of the site's cars relative to the atlas; 0 where only cars determine the scale.
    pub size_of_cars: f64,
}

/// Fuses the windows of a clip like [`fuse`], and also returns the size of the cars.
#[must_use]
pub fn join(windows: &[WindowEstimate], options: &FuseOptions) -> Joined {
    let mut usable: Vec<&WindowEstimate> = windows.iter().filter(|window| is_usable(window)).collect();
    // Windows of a position to which the camera returns come together.
    usable.sort_by(|a, b| a.position.cmp(&b.position).then(a.span_s[0].total_cmp(&b.span_s[0])));
    let at_one = |windows| Position {
        windows,
        cars: evidence_of_cars(windows, options),
        factors: options.factors.get(&windows[0].position).into_iter().flatten().collect(),
    };
    let positions: Vec<Position<'_>> = usable.chunk_by(|a, b| a.position == b.position).map(at_one).collect();
    let (nodes, states) = solve(&positions, options);
    let solved = positions.iter().zip(&nodes).zip(&states);
    let of_one = |((position, node), state): ((&Position<'_>, _), _)| {
        (position.windows[0].position, estimate(position.windows, node, state, options))
    };
    Joined {
        estimates: solved.map(of_one).collect(),
        size_of_cars: states.last().map_or(0.0, Gaussian::size_of_cars),
    }
}

/// The windows of one camera position, and all evidence on its camera.
struct Position<'a> {
    /// The windows, in the order of time.
    windows: &'a [&'a WindowEstimate],
    /// Evidence of cars on (log f, horizon, roll, log h'), and the camera (log f, tilt, roll, log h') that it shows.
    cars: (Evidence, Vector4<f64>),
    factors: Vec<&'a Factor>,
}

/// Returns the evidence of a group of windows, and the camera at which it was linearised.
fn evidence_of_cars(windows: &[&WindowEstimate], options: &FuseOptions) -> (Evidence, Vector4<f64>) {
    let joint = together(windows, options);
    let prior = options.prior.to_vector();
    let camera = mean(&joint, options).unwrap_or(prior);
    let (information, weighted) = joint.marginal(options.shared_sd);
    of_horizon(&Evidence { information, weighted }, &camera)
        .map_or_else(|| (Evidence::none(), prior), |evidence| (evidence, camera))
}

/// Returns the nodes with all their evidence, and the smoothed states.
///
/// Cars and factors are no Gaussians of the camera parameters, so each round linearises them at the last states.
fn solve(positions: &[Position<'_>], options: &FuseOptions) -> (Vec<Node>, Vec<Gaussian>) {
    let mut factors: Vec<Vec<Evidence>> =
        positions.iter().map(|position| vec![Evidence::none(); position.factors.len()]).collect();
    let mut at: Vec<[Vector4<f64>; 2]> = positions.iter().map(|position| [position.cars.1; 2]).collect();
    let mut states: Vec<Gaussian> = Vec::new();
    let mut nodes = Vec::new();
    for _ in 0..MOST_ROUNDS {
        nodes.clear();
        for (i, (position, factors)) in positions.iter().zip(&mut factors).enumerate() {
            let cars = linearised(&position.cars.0, &at[i][0]);
            let mut node = Node { cars, metres: Evidence::none() };
            // The first round has cars alone. It shows where the factors are to be linearised.
            if let Some(state) = states.get(i) {
                let all = state.evidence();
                for (factor, evidence) in position.factors.iter().zip(factors) {
                    // The scale of these comes from the sizes of cars, not from measured metres.
                    let of_cars = matches!(factor, Factor::Survey(survey) if survey.by_cars);
                    let rest = all.filter(|_| !of_cars).map(|all| all.without(evidence));
                    *evidence = Evidence::of_factor(factor, &at[i][usize::from(!of_cars)], rest.as_ref());
                    let sum = if of_cars { &mut node.cars } else { &mut node.metres };
                    *sum = sum.and(evidence);
                }
            }
            nodes.push(node);
        }
        let is_first = states.is_empty();
        states = smooth(&nodes, options);
        // In the scale of the atlas's cars, and in metres.
        let here: Vec<_> = states.iter().map(|state| [state.by_cars(), state.camera().0]).collect();
        let moved = here.iter().zip(&at).map(|(here, at)| (here[1] - at[1]).amax()).fold(0.0, f64::max);
        at = here;
        if moved < STILL && !is_first {
            break;
        }
    }
    (nodes, states)
}

/// Builds the camera estimate of a group from its smoothed state.
fn estimate(
    group: &[&WindowEstimate],
    node: &Node,
    state: &Gaussian,
    options: &FuseOptions,
) -> CameraEstimate {
    let (params, covariance) = state.camera();
    let information = node.cars.and(&node.metres).information;
    let prior = options.prior_sd.map(|sd| 1.0 / (sd * sd));
    let determined = |number: usize| is_determined(number, &information, &prior);
    let status = if !(determined(1) && determined(3)) {
        CameraStatus::Unobservable
    } else if options.focal_given {
        CameraStatus::FocalGiven
    } else if determined(0) {
        CameraStatus::Estimated
    } else {
        CameraStatus::FocalFromPrior
    };
    let cars: BTreeSet<CarIdentity> =
        group.iter().flat_map(|window| window.cars.iter().map(|used| used.car)).collect();
    CameraEstimate {
        params: CameraParams::from_vector(&params),
        covariance,
        status,
        cars_used: cars.len(),
        frames_used: group.iter().map(|window| window.frames).sum(),
        ..options.unobservable(span_s(group))
    }
}
