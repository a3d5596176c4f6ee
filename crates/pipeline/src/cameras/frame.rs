//! Estimates the camera of a single frame: as the product does, and by the paper's Algorithm 1.

use roadplane_base::{
    CameraEstimate, CameraStatus, FrameRecord, ImageSize, KEYPOINTS, KeypointSet, SceneCurve, ShapeAtlas,
};
use roadplane_calibrate::{FuseOptions, WindowEstimate, fuse};
use roadplane_measure::usable;
use roadplane_solve::{
    CarView, FreeCarFit, PlaneTerms, SceneOptions, SceneStatus, solve_free_scene, solve_scene,
};

use crate::Config;
use crate::cameras::joining::fuse_options;
use crate::cameras::known::CameraConstraints;
use crate::cameras::lens::LensOfClip;

/// Estimates the camera of a single frame.
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
    let sets: Vec<KeypointSet> = frame
        .cars
        .iter()
        .filter_map(|car| car.keypoints.as_deref())
        .map(|set| usable(set, config.solve.min_keypoint_score))
        .collect();
    let solution = solve_scene(atlas, size, &CarView::each(&sets), &options);
    let cars_used = solution.cars.iter().flatten().filter(|car| car.used).count();
    let options = fuse_options(size, 1, &known, config);
    let mut window = WindowEstimate::without_cars(&options, [frame.time_s; 2], 0);
    if solution.status.usable() {
        (window.params, window.joint) = solution.by_cars();
    }
    let windows = [window];
    let options = lens.count(&windows, options);
    let estimate = fuse(&windows, &options).pop().unwrap_or_else(|| options.unobservable([frame.time_s; 2]));
    CameraEstimate { cars_used, frames_used: usize::from(cars_used > 0), ..estimate }
}

/// Sds of cars' distance (m) and angle (dimensionless) from a common plane in the paper's method: kerbs, springs,
/// loads.
pub const PLANE_TERMS: PlaneTerms = PlaneTerms { distance_sd_m: 0.05, angle_sd: 0.02 };

/// Solves a single frame by the paper's Algorithm 1.
///
/// Returns the camera and the free pose of each car (`None` where no pose can be fitted). Of the user constraints only
/// an exact focal length and the lens are used. Nothing else of the scene is used.
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
        .map(|car| {
            car.keypoints.as_deref().map_or(unseen, |set| usable(set, config.solve.min_keypoint_score))
        })
        .collect();
    let solution = solve_free_scene(atlas, size, &CarView::each(&sets), Some(PLANE_TERMS), &options);
    let cars_used = solution.cars.iter().flatten().count();
    let status = match solution.status {
        SceneStatus::Converged | SceneStatus::NotConverged => CameraStatus::Estimated,
        SceneStatus::FocalGiven => CameraStatus::FocalGiven,
        SceneStatus::FocalFromPrior => CameraStatus::FocalFromPrior,
        SceneStatus::TooFewCars | SceneStatus::Failed => CameraStatus::Unobservable,
    };
    let options =
        FuseOptions { lens: lens.lens, distortion_sd: lens.distortion_sd, ..FuseOptions::for_image(size) };
    let camera = CameraEstimate {
        params: solution.params,
        covariance: solution.covariance,
        status,
        cars_used,
        frames_used: usize::from(cars_used > 0),
        ..options.unobservable([frame.time_s; 2])
    };
    (camera, solution.cars)
}

/// Returns the camera of a frame before any car is used: the prior and the user constraints.
#[must_use]
pub fn prior_camera(frame: &FrameRecord, known: &CameraConstraints, config: &Config) -> CameraEstimate {
    let (size, span_s) = (frame.image_size_px, [frame.time_s; 2]);
    let (lens, known, _) = before_cars(&[], size, known, config);
    let options = fuse_options(size, 1, &known, config);
    let options = FuseOptions { lens: lens.lens, distortion_sd: lens.distortion_sd, ..options };
    let given = (!known.is_silent()).then(|| WindowEstimate::without_cars(&options, span_s, 0));
    fuse(given.as_slice(), &options).pop().unwrap_or_else(|| options.unobservable(span_s))
}

/// Returns everything that precedes the cars: the lens, the user constraints seen through it, and the solver's options.
fn before_cars(
    curves: &[SceneCurve],
    size: ImageSize,
    known: &CameraConstraints,
    config: &Config,
) -> (LensOfClip, CameraConstraints, SceneOptions) {
    let lens = LensOfClip::new(curves, None, size, known, None, config);
    let known = known.seen_through(lens.lens);
    let mut options = config.solve.scene_options(known.focal_px());
    options.lens = lens.lens;
    (lens, known, options)
}
