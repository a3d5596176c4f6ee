//! The camera of one frame on its own: as the product solves it, and by the paper's Algorithm 1.

use nalgebra::Matrix4;
use roadplane_base::{
    CameraEstimate, CameraParams, CameraStatus, FrameRecord, ImageSize, KEYPOINTS, KeypointSet, SceneCurve,
    ShapeAtlas,
};
use roadplane_calibrate::{WindowEstimate, fuse};
use roadplane_solve::{
    CarView, FreeCarFit, PlaneTerms, SceneOptions, SceneStatus, solve_free_scene, solve_scene,
};

use crate::Config;
use crate::cameras::joining::{factors_of_window, fuse_options, nothing_seen};
use crate::cameras::known::CameraConstraints;
use crate::cameras::lens::LensOfClip;
use crate::cameras::window::by_cars_alone;
use crate::tracks::believe::usable;

/// Solves one frame on its own.
#[must_use]
pub fn estimate_frame(
    frame: &FrameRecord,
    atlas: &ShapeAtlas,
    known: &CameraConstraints,
    config: &Config,
) -> CameraEstimate {
    let size = frame.image_size_px;
    let curves = frame.scene_curves.as_deref().unwrap_or_default();
    let (lens, known, options) = before_cars(curves, size, known, config);
    let sets: Vec<KeypointSet> =
        frame.cars.iter().filter_map(|car| car.keypoints.as_deref()).map(|set| usable(set, config)).collect();
    let solution = solve_scene(atlas, size, &CarView::each(&sets), &options);
    let cars_used = solution.cars.iter().flatten().filter(|car| car.used).count();
    if !known.is_silent() {
        let fuse_options = lens.count(&[], fuse_options(size, 0, &known, config));
        let silent = nothing_seen(&fuse_options, [frame.time_s; 2], 0);
        let window = if solution.status.usable() {
            let (params, joint) = by_cars_alone(&solution);
            WindowEstimate { params, solved: solution.params, joint, ..silent }
        } else {
            silent
        };
        if let Some(estimate) = fuse(&[window], &fuse_options).pop() {
            return CameraEstimate { cars_used, frames_used: usize::from(cars_used > 0), ..estimate };
        }
    }
    of_solution(frame, &lens, solution.status, (solution.params, solution.covariance), cars_used)
}

/// How far cars stand from a common plane where they are drawn to it, as by the paper: kerbs, springs, loads.
pub const PLANE_TERMS: PlaneTerms = PlaneTerms { distance_sd_m: 0.05, angle_sd: 0.02 };

/// Solves one frame on its own by the paper's Algorithm 1: the camera, and each car's free pose (one a car; `None` where nothing could be
/// fitted). Of what is known of the camera its numbers count; nothing else of the scene does.
#[must_use]
pub fn estimate_frame_as_paper(
    frame: &FrameRecord,
    atlas: &ShapeAtlas,
    known: &CameraConstraints,
    config: &Config,
) -> (CameraEstimate, Vec<Option<FreeCarFit>>) {
    let size = frame.image_size_px;
    let (lens, _, options) = before_cars(&[], size, known, config);
    let unseen: KeypointSet = [None; KEYPOINTS];
    let sets: Vec<KeypointSet> = frame
        .cars
        .iter()
        .map(|car| car.keypoints.as_deref().map_or(unseen, |set| usable(set, config)))
        .collect();
    let solution = solve_free_scene(atlas, size, &CarView::each(&sets), Some(PLANE_TERMS), &options);
    let cars_used = solution.cars.iter().flatten().count();
    let camera = (solution.params, solution.covariance);
    (of_solution(frame, &lens, solution.status, camera, cars_used), solution.cars)
}

/// What stands before any car is looked at: the lens, what is known of the camera seen through it, and the solver's options.
fn before_cars(
    curves: &[SceneCurve],
    size: ImageSize,
    known: &CameraConstraints,
    config: &Config,
) -> (LensOfClip, CameraConstraints, SceneOptions) {
    let lens = LensOfClip::new(curves, size, known, None, config);
    let known = known.seen_through(lens.lens());
    let mut options = config.solve.scene_options(known.focal_px());
    options.lens = lens.lens();
    options.factors = factors_of_window(&known.factors(0, size));
    (lens, known, options)
}

/// A frame's camera as a solve has it, by so many cars.
fn of_solution(
    frame: &FrameRecord,
    lens: &LensOfClip,
    status: SceneStatus,
    (params, covariance): (CameraParams, Matrix4<f64>),
    cars_used: usize,
) -> CameraEstimate {
    let status = match status {
        SceneStatus::Converged | SceneStatus::NotConverged => CameraStatus::Estimated,
        SceneStatus::FocalGiven => CameraStatus::FocalGiven,
        SceneStatus::FocalFromPrior => CameraStatus::FocalFromPrior,
        SceneStatus::TooFewCars | SceneStatus::Failed => CameraStatus::Unobservable,
    };
    CameraEstimate {
        span_s: [frame.time_s; 2],
        image_size_px: frame.image_size_px,
        principal_point_px: frame.image_size_px.centre_px(),
        lens: lens.lens(),
        bend_sd: lens.bend_sd(),
        params,
        covariance,
        status,
        cars_used,
        frames_used: usize::from(cars_used > 0),
    }
}
