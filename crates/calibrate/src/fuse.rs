//! The factor graph of a clip's camera: fuses the windows and all other factors over time.
//!
//! The unknowns are (log f, tilt, roll, log h) of each camera position, and the size of the place's cars. The evidence
//! is
//!
//! - the cars: each window gives a Gaussian of (log f, tilt, roll, log h) from their keypoints, with its dependence on
//!   the errors that all cars of the place share; the mean of the windows of a position counts as a Gaussian of (log f,
//!   horizon, roll, log h);
//! - [`Factor`]s: user constraints, verticals, turns; a factor counts once at its camera position;
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

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{
    CameraEstimate, CameraParams, CameraPrior, CameraStatus, ImageSize, JointInformation, Lens,
    SHARED_ERRORS, SharedSd, is_determined,
};

use self::evidence::Evidence;
pub(crate) use self::group::VIEW_CORRELATION;
pub use self::group::condense;
use self::group::{is_usable, mean, span_s, together};
use self::horizon::{linearised, of_horizon};
use self::nodes::{Gaussian, Node, smooth};
use crate::factors::Factor;
use crate::prior::FusePrior;
use crate::{LinkId, MOST_ROUNDS};

/// Identity of a car among all windows that are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CarIdentity {
    /// A car of the clip.
    Clip(LinkId),
    /// A car of the camera database.
    Stored(LinkId),
}

/// A car that was used in a window's estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CarUse {
    /// Identity of the car.
    pub car: CarIdentity,
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
    /// Evidence of the keypoints on the camera and on the errors that the site's cars share, without a camera prior.
    ///
    /// It may be singular. Without the shared errors its mean is `params`.
    pub joint: JointInformation,
    /// Cars that were used.
    pub cars: Vec<CarUse>,
    /// Index of the camera position, from 0, as in [`Window`](crate::Window).
    pub segment: usize,
}

impl WindowEstimate {
    /// Returns a window without cars.
    #[must_use]
    pub fn without_cars(options: &FuseOptions, span_s: [f64; 2], segment: usize) -> Self {
        Self {
            span_s,
            frames: 0,
            params: options.prior.params,
            joint: JointInformation::none(),
            cars: Vec::new(),
            segment,
        }
    }
}

/// Options for joining windows.
#[derive(Clone, Debug)]
pub struct FuseOptions {
    /// Size of the pictures; copied to the result.
    pub image_size_px: ImageSize,
    /// Whether the user gave the focal length; the prior then contains it.
    pub focal_given: bool,
    /// Prior of the camera; it is counted once.
    pub prior: FusePrior,
    /// Sds of the errors that all cars of the site share, and so all windows. The scatter of windows does not show
    /// them.
    pub shared_sd: SharedSd,
    /// Lens distortion with which the windows were solved.
    pub lens: Lens,
    /// Sd of the distortion ([`Lens::distortion`]); `None` where neither the picture nor the user determines it.
    pub bend_sd: Option<f64>,
    /// Other factors on the camera, by camera position ([`WindowEstimate::segment`]). Each factor is counted once.
    pub factors: BTreeMap<usize, Vec<Factor>>,
    /// Whether the positions are the two planes of a folded ground below one camera ([`Fold`](crate::Fold)).
    pub is_folded: bool,
    /// Sd of the log size of the site's cars relative to the atlas.
    ///
    /// All windows share this error of scale. Factors in metres determine it.
    pub size_of_cars_sd: f64,
}

impl FuseOptions {
    /// Returns the options without factors, for the camera from cars alone, in units of the atlas's cars.
    #[must_use]
    pub fn for_cars(&self) -> Self {
        Self { factors: BTreeMap::new(), size_of_cars_sd: 0.0, ..self.clone() }
    }

    /// Returns an estimate with the numbers and sds of the prior, and the status "unobservable".
    #[must_use]
    pub fn unobservable(&self, span_s: [f64; 2]) -> CameraEstimate {
        CameraEstimate {
            span_s,
            image_size_px: self.image_size_px,
            principal_point_px: self.image_size_px.centre_px(),
            lens: self.lens,
            distortion_sd: self.bend_sd,
            params: self.prior.params,
            covariance: Matrix4::from_diagonal(&self.prior.sd.map(|sd| sd * sd)),
            status: CameraStatus::Unobservable,
            cars_used: 0,
            frames_used: 0,
            second_plane: None,
        }
    }

    /// Returns the defaults for pictures of this size: the default [`CameraPrior`].
    #[must_use]
    pub fn for_image(image_size_px: ImageSize) -> Self {
        let prior = CameraPrior::default();
        Self {
            image_size_px,
            focal_given: false,
            prior: FusePrior { params: prior.mean(image_size_px), sd: prior.sd() },
            shared_sd: [0.0; SHARED_ERRORS],
            lens: Lens::STRAIGHT,
            bend_sd: None,
            factors: BTreeMap::new(),
            is_folded: false,
            size_of_cars_sd: 0.0,
        }
    }
}

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
    usable.sort_by(|a, b| a.segment.cmp(&b.segment).then(a.span_s[0].total_cmp(&b.span_s[0])));
    let pieces = pieces(&usable, options);
    let (nodes, states) = solve(&pieces, options);
    let solved = pieces.iter().zip(&nodes).zip(&states);
    let of_piece = |((piece, node), state): ((&Piece<'_, '_>, &Node), &Gaussian)| {
        (piece.windows[0].segment, estimate(piece.windows, node, state, options))
    };
    Joined {
        estimates: solved.map(of_piece).collect(),
        size_of_cars: states.last().map_or(0.0, Gaussian::size_of_cars),
    }
}

/// The windows of one camera position, and all evidence on its camera.
struct Piece<'a, 'w> {
    /// The windows, in the order of time.
    windows: &'a [&'w WindowEstimate],
    /// Evidence of cars on (log f, horizon, roll, log h'), and the camera (log f, tilt, roll, log h') that it shows.
    cars: (Evidence, Vector4<f64>),
    /// Other factors.
    factors: Vec<&'a Factor>,
}

/// Divides windows into pieces, one per camera position. `usable` is sorted by position and time.
fn pieces<'a, 'w>(usable: &'a [&'w WindowEstimate], options: &'a FuseOptions) -> Vec<Piece<'a, 'w>> {
    let positions = usable.chunk_by(|a, b| a.segment == b.segment);
    let piece = |windows: &'a [&'w WindowEstimate]| Piece {
        windows,
        cars: evidence_of_cars(windows, options),
        factors: options.factors.get(&windows[0].segment).into_iter().flatten().collect(),
    };
    positions.map(piece).collect()
}

/// Returns the evidence of a group of windows, and the camera at which it was linearised.
fn evidence_of_cars(windows: &[&WindowEstimate], options: &FuseOptions) -> (Evidence, Vector4<f64>) {
    let joint = together(windows, options);
    let prior = options.prior.params.to_vector();
    let camera = mean(&joint.information, &joint.vector, options).unwrap_or(prior);
    let (information, weighted) = joint.marginal(options.shared_sd);
    of_horizon(&Evidence { information, weighted }, &camera)
        .map_or_else(|| (Evidence::none(), prior), |evidence| (evidence, camera))
}

/// Returns the nodes with all their evidence, and the smoothed states.
///
/// Cars and factors are no Gaussians of the camera parameters, so each round linearises them at the last states.
fn solve(pieces: &[Piece<'_, '_>], options: &FuseOptions) -> (Vec<Node>, Vec<Gaussian>) {
    let mut factors: Vec<Vec<Evidence>> =
        pieces.iter().map(|piece| vec![Evidence::none(); piece.factors.len()]).collect();
    let mut at: Vec<[Vector4<f64>; 2]> = pieces.iter().map(|piece| [piece.cars.1; 2]).collect();
    let mut states: Vec<Gaussian> = Vec::new();
    let mut nodes = Vec::new();
    for _ in 0..MOST_ROUNDS {
        nodes.clear();
        for (i, (piece, factors)) in pieces.iter().zip(&mut factors).enumerate() {
            let cars = linearised(&piece.cars.0, &at[i][0]);
            let mut node = Node { cars, metres: Evidence::none() };
            // The first round has cars alone. It shows where the factors are to be linearised.
            if let Some(state) = states.get(i) {
                let all = state.evidence();
                for (factor, evidence) in piece.factors.iter().zip(factors) {
                    let of_cars = factor.is_by_cars();
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
        let here: Vec<[Vector4<f64>; 2]> = states.iter().map(both_scales).collect();
        let moved = here.iter().zip(&at).map(|(here, at)| (here[1] - at[1]).amax()).fold(0.0, f64::max);
        at = here;
        if moved < STILL && !is_first {
            break;
        }
    }
    (nodes, states)
}

/// Returns (log f, tilt, roll, log h) twice: in the scale of the atlas's cars, and in metres.
fn both_scales(state: &Gaussian) -> [Vector4<f64>; 2] {
    [state.by_cars(), state.camera().0]
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
