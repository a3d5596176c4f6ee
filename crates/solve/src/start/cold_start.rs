//! From nothing to a few starts for the joint refinement.
//!
//! 0. every car's possible view directions, no camera needed (`weak_perspective.rs`);
//! 1. for each of a ladder of focal lengths the planes that the cars agree on (`up_consensus.rs`);
//! 2. every car placed on that plane in closed form (`standing.rs`);
//! 3. a short joint refinement of camera and poses with the mean shape and forgiving whitening;
//! 4. the best few by cost.

use nalgebra::Vector4;
use roadplane_base::Shape;

use crate::linear::lm::{LmOptions, minimise};
use crate::model::pose::CameraFrame;
use crate::model::standing::Standing;
use crate::problem::setup::{Placed, Setup, Sight};
use crate::start::standing::standing_candidates;
use crate::start::up_consensus::planes_for_focal;
use crate::start::weak_perspective::DirectionGrid;

/// Focal lengths that are tried, in units of the longer image side; a refinement bridges the gaps.
const FOCAL_RATIOS: [f64; 6] = [0.4, 0.7, 1.2, 2.1, 3.6, 6.2];
/// Planes per focal length.
const PLANES: usize = 2;
/// Of all planes and focal lengths, those with the best placed cars that are refined.
const SKETCHES: usize = 6;
/// View directions kept per car.
const APPEARANCES: usize = 6;
/// Cars whose view directions are searched: more do not change the consensus.
const MAX_VOTERS: usize = 12;
/// sd that the unknown shape adds in the first refinement, m.
pub(crate) const COARSE_SD_M: f64 = 0.12;

/// A start: camera, placed cars, coarse cost.
#[derive(Clone, Debug)]
pub(crate) struct Start {
    pub cost: f64,
    pub camera: Vector4<f64>,
    pub placed: Vec<Option<Placed<Standing>>>,
}

/// Starts, best first.
pub(crate) fn cold_starts(setup: &Setup<'_>, most: usize) -> Vec<Start> {
    let grid = DirectionGrid::new();
    let points = setup.atlas.keypoints_in_car(&Shape::zeros());
    // The cars with most keypoints know their direction best.
    let mut order: Vec<usize> = (0..setup.sights.len()).collect();
    order.sort_by_key(|s| (std::cmp::Reverse(setup.sights[*s].observations.len()), *s));
    let voters: Vec<_> = order
        .iter()
        .take(MAX_VOTERS)
        .map(|s| grid.appearances(&points, &setup.sights[*s].observations, APPEARANCES))
        .collect();
    let longer = f64::from(setup.size.width.max(setup.size.height));
    let focals: Vec<f64> = match setup.knowledge.fixed[0] {
        true => vec![setup.knowledge.mean[0].exp()],
        false => FOCAL_RATIOS.iter().map(|ratio| ratio * longer).collect(),
    };
    let mut sketches: Vec<Start> = focals
        .iter()
        .flat_map(|focal_px| planes_for_focal(&voters, *focal_px, PLANES))
        .map(|camera| place_all(setup, &camera))
        .collect();
    sketches.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    sketches.truncate(SKETCHES);
    let mut starts: Vec<Start> = sketches.into_iter().filter_map(|sketch| coarse(setup, sketch)).collect();
    starts.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut kept: Vec<Start> = Vec::new();
    for start in starts {
        if kept.len() < most && !kept.iter().any(|other| same_minimum(other, &start)) {
            kept.push(start);
        }
    }
    kept
}

/// Whether two refined starts have run into the same minimum.
fn same_minimum(a: &Start, b: &Start) -> bool {
    let poses = a.placed.iter().zip(&b.placed).all(|(a, b)| match (a, b) {
        (Some(a), Some(b)) => roadplane_base::angle_difference(a.pose.heading, b.pose.heading).abs() < 0.1,
        (None, None) => true,
        _ => false,
    });
    poses && (a.camera - b.camera).amax() < 0.05
}

/// Every sight's best pose before this camera, mean shape, with what that costs.
pub(crate) fn place_all(setup: &Setup<'_>, camera: &Vector4<f64>) -> Start {
    let frame = CameraFrame::new(camera);
    let points = setup.atlas.keypoints_in_car(&Shape::zeros());
    let best = |sight: &Sight| standing_candidates(&frame, &points, &sight.observations, 1).first().copied();
    let found: Vec<Option<(f64, Standing)>> = setup.sights.iter().map(best).collect();
    let placed: Vec<_> =
        found.iter().map(|best| best.map(|(_, pose)| Placed { pose, shape: Shape::zeros() })).collect();
    let cost = found.iter().flatten().map(|(cost, _)| cost).sum::<f64>() + setup.cost_of_missing(&placed);
    Start { cost, camera: *camera, placed }
}

/// A short refinement of camera and poses; `None` when no car could be placed.
pub(crate) fn coarse(setup: &Setup<'_>, sketch: Start) -> Option<Start> {
    let placed = sketch.placed;
    let (mut problem, members) = setup.problem(sketch.camera, &placed);
    if members.is_empty() {
        return None;
    }
    problem.shapes_fixed = true;
    let quick =
        LmOptions { max_iterations: 10, cost_tolerance: 3e-3, step_tolerance: 3e-2, ..setup.options.lm };
    problem.whiten(setup.options.atlas_residual_scale, COARSE_SD_M);
    let report = minimise(&mut problem, &quick);
    let cost = report.cost + setup.cost_of_missing(&placed);
    cost.is_finite().then(|| Start {
        cost,
        camera: problem.state.camera,
        placed: setup.read_back(&problem, &members),
    })
}
