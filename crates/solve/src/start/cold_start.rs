//! The search for start values of the joint refinement, when the camera is unknown.
//!
//! The search has five steps:
//!
//! 1. Find possible view directions of every car; this needs no camera (`weak_perspective.rs`).
//! 2. For each of several focal lengths, find ground planes that agree with most cars (`up_consensus.rs`).
//! 3. Compute the pose of every car on each plane, in closed form (`on_plane.rs`).
//! 4. Refine camera and poses jointly for a few iterations, with the mean shape and large keypoint sds.
//! 5. Return the few starts of lowest cost.

use nalgebra::Vector4;
use roadplane_base::Shape;

use crate::linear::lm::{LmOptions, minimise};
use crate::model::on_plane::PlanePose;
use crate::model::pose::CameraFrame;
use crate::problem::setup::{PoseAndShape, Setup, UsableView};
use crate::start::on_plane::plane_pose_candidates;
use crate::start::up_consensus::planes_for_focal;
use crate::start::weak_perspective::DirectionGrid;

/// Focal lengths that are tried, in units of the longer image side. The refinement reaches the values between them.
const FOCAL_RATIOS: [f64; 6] = [0.4, 0.7, 1.2, 2.1, 3.6, 6.2];
/// Number of ground planes that are tried per focal length.
const PLANES: usize = 2;
/// Number of cameras that are refined. They have the lowest cost over all planes and focal lengths.
const SKETCHES: usize = 6;
/// Number of possible view directions per car.
const APPEARANCES: usize = 6;
/// Largest number of cars whose view directions are searched. More cars would hardly change the planes found.
const MAX_VOTERS: usize = 12;
/// Sd of a keypoint due to the car's unknown shape, in the first refinement, m.
pub(crate) const COARSE_SD_M: f64 = 0.12;

/// Start values of the descent: the camera, the pose and shape of each usable view's car, and their rough cost.
#[derive(Clone, Debug)]
pub(crate) struct Start {
    pub cost: f64,
    pub camera: Vector4<f64>,
    pub placed: Vec<Option<PoseAndShape<PlanePose>>>,
}

/// Returns at most `most` starts that lead to different minima, lowest cost first.
pub(crate) fn cold_starts(setup: &Setup<'_>, most: usize) -> Vec<Start> {
    let grid = DirectionGrid::new();
    let points = setup.atlas.keypoints_in_car(&Shape::zeros());
    // Cars with many keypoints determine their view direction best.
    let mut order: Vec<usize> = (0..setup.usable_views.len()).collect();
    order.sort_by_key(|s| (std::cmp::Reverse(setup.usable_views[*s].observations.len()), *s));
    let voters: Vec<_> = order
        .iter()
        .take(MAX_VOTERS)
        .map(|s| grid.appearances(&points, &setup.usable_views[*s].observations, APPEARANCES))
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

/// Whether two refined starts are at the same minimum.
fn same_minimum(a: &Start, b: &Start) -> bool {
    let poses = a.placed.iter().zip(&b.placed).all(|(a, b)| match (a, b) {
        (Some(a), Some(b)) => roadplane_base::angle_difference(a.pose.heading, b.pose.heading).abs() < 0.1,
        (None, None) => true,
        _ => false,
    });
    poses && (a.camera - b.camera).amax() < 0.05
}

/// Returns a start with this camera, the mean shape, and the best pose of the car in each view.
pub(crate) fn place_all(setup: &Setup<'_>, camera: &Vector4<f64>) -> Start {
    let frame = CameraFrame::new(camera);
    let points = setup.atlas.keypoints_in_car(&Shape::zeros());
    let best = |usable_view: &UsableView| {
        plane_pose_candidates(&frame, &points, &usable_view.observations, 1).first().copied()
    };
    let found: Vec<Option<(f64, PlanePose)>> = setup.usable_views.iter().map(best).collect();
    let placed: Vec<_> =
        found.iter().map(|best| best.map(|(_, pose)| PoseAndShape { pose, shape: Shape::zeros() })).collect();
    let cost = found.iter().flatten().map(|(cost, _)| cost).sum::<f64>() + setup.cost_of_missing(&placed);
    Start { cost, camera: *camera, placed }
}

/// Refines a start's camera and poses in a few iterations; returns `None` if no car has a pose.
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
