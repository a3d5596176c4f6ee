//! The camera of a clip: windows of views → joint solves → one estimate per stretch of time.

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{
    Camera, CameraEstimate, CameraParams, CameraStatus, FrameRecord, ImageSize, KeypointSet, ShapeAtlas,
};
use roadplane_calibrate::{
    CarUse, EvidenceBuilder, EvidenceOptions, FuseOptions, FusePrior, View, Window, WindowEstimate, fuse,
};
use roadplane_solve::{CarView, SceneOptions, SceneStatus, solve_scene};

use crate::believe::{is_believable, projected_box};
use crate::{Config, PipelineError};

/// sd of log focal that stands for "given".
const GIVEN_LOG_FOCAL_SD: f64 = 1e-6;
/// sd of the mean size of a place's cars against the shape atlas', log: those of the USA are some 6 % longer than Europe's,
/// Japan's as much shorter (estimates). Every car of a clip shares it, and heights and distances scale with it.
const POPULATION_LOG_SD: f64 = 0.04;

/// The camera at every time of a clip.
#[derive(Clone, Debug)]
pub struct CameraTrack {
    estimates: Vec<CameraEstimate>,
    /// When each position of the camera after the first began, s.
    moves_s: Vec<f64>,
}

impl CameraTrack {
    /// Of estimates that were read back.
    #[must_use]
    pub fn from_estimates(estimates: Vec<CameraEstimate>) -> Self {
        Self { estimates, moves_s: Vec::new() }
    }

    /// One estimate per stretch of time, in order; never empty.
    #[must_use]
    pub fn estimates(&self) -> &[CameraEstimate] {
        &self.estimates
    }

    /// Counts the positions that the camera was moved to up to a time.
    #[must_use]
    pub fn position_at(&self, time_s: f64) -> usize {
        self.moves_s.iter().filter(|from_s| **from_s <= time_s).count()
    }

    /// The estimate that holds at a time: whose stretch contains it, else the nearest.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<&CameraEstimate> {
        self.estimates.get(self.segment_at(time_s))
    }

    /// Place of that estimate among all, from 0.
    #[must_use]
    pub fn segment_at(&self, time_s: f64) -> usize {
        let distance = |i: &usize| {
            let [from, to] = self.estimates[*i].span_s;
            (from - time_s).max(time_s - to).max(0.0)
        };
        let nearest = (0..self.estimates.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.unwrap_or(0)
    }
}

/// The keypoints that are sure enough to be used.
#[must_use]
pub fn usable(keypoints: &KeypointSet, config: &Config) -> KeypointSet {
    keypoints.map(|point| point.filter(|point| point.score >= config.solve.min_keypoint_score))
}

/// Estimates the camera from all frames, or says that nothing could be estimated.
///
/// # Errors
/// Whatever reading a frame failed with.
pub fn estimate_cameras(
    frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
    atlas: &ShapeAtlas,
    known_focal_px: Option<f64>,
    config: &Config,
) -> Result<CameraTrack, PipelineError> {
    let mut options = config.solve.scene_options(known_focal_px);
    // Windows say what each alone would; what their cars' errors have in common is counted where they are fused.
    let dispersion = std::mem::replace(&mut options.camera_dispersion, 1.0);
    let mut builder = EvidenceBuilder::new(EvidenceOptions {
        window_s: config.calibrate.window_s,
        ..EvidenceOptions::default()
    });
    let mut windows = Vec::new();
    let mut moves_s: Vec<f64> = Vec::new();
    let mut size = None;
    let mut span_s = [f64::INFINITY, f64::NEG_INFINITY];
    let mut frame_count = 0;
    let mut take = |window: Option<Window>, size: ImageSize, options: &mut SceneOptions| {
        if let Some(window) = window.as_ref().filter(|window| window.segment > moves_s.len()) {
            moves_s.push(window.span_s[0]);
        }
        if let Some(estimate) = window.and_then(|window| solve_window(&window, atlas, size, options, config))
        {
            options.start = Some(estimate.params);
            windows.push(estimate);
        }
    };
    for frame in frames {
        let mut frame = frame?;
        let image_size = *size.get_or_insert(frame.image_size_px);
        span_s = [span_s[0].min(frame.time_s), span_s[1].max(frame.time_s)];
        frame_count += 1;
        for car in &mut frame.cars {
            if let Some(set) = &mut car.keypoints {
                **set = usable(set, config);
            }
        }
        take(builder.push(frame), image_size, &mut options);
    }
    let Some(size) = size else {
        return Ok(CameraTrack { estimates: Vec::new(), moves_s });
    };
    take(builder.finish(), size, &mut options);
    let prior = fuse_prior(&options, size);
    let fuse_options = FuseOptions {
        focal_given: known_focal_px.is_some(),
        prior,
        dispersion,
        ..FuseOptions::for_image(size)
    };
    let mut estimates = fuse(&windows, &fuse_options);
    for estimate in &mut estimates {
        estimate.covariance[(3, 3)] += POPULATION_LOG_SD * POPULATION_LOG_SD;
    }
    if estimates.is_empty() {
        estimates.push(unobservable(&fuse_options, span_s, size));
        tracing::warn!("the camera cannot be estimated from the cars of {frame_count} frames");
    }
    Ok(CameraTrack { estimates, moves_s })
}

/// Solves one frame on its own.
#[must_use]
pub fn estimate_frame(
    frame: &FrameRecord,
    atlas: &ShapeAtlas,
    options: &SceneOptions,
    config: &Config,
) -> CameraEstimate {
    let size = frame.image_size_px;
    let sets: Vec<KeypointSet> =
        frame.cars.iter().filter_map(|car| car.keypoints.as_deref()).map(|set| usable(set, config)).collect();
    let views: Vec<CarView<'_>> =
        sets.iter().enumerate().map(|(group, keypoints)| CarView { keypoints, group, weight: 1.0 }).collect();
    let solution = solve_scene(atlas, size, &views, options);
    let cars_used = solution.cars.iter().flatten().filter(|car| car.used).count();
    let status = match solution.status {
        SceneStatus::Converged | SceneStatus::NotConverged => CameraStatus::Estimated,
        SceneStatus::FocalGiven => CameraStatus::FocalGiven,
        SceneStatus::FocalFromPrior => CameraStatus::FocalFromPrior,
        SceneStatus::TooFewCars | SceneStatus::Failed => CameraStatus::Unobservable,
    };
    CameraEstimate {
        span_s: [frame.time_s; 2],
        image_size_px: size,
        principal_point_px: size.centre_px(),
        params: solution.params,
        covariance: solution.covariance,
        status,
        cars_used,
        frames_used: usize::from(cars_used > 0),
    }
}

/// The camera before any car is looked at.
#[must_use]
pub fn prior_camera(options: &SceneOptions, frame: &FrameRecord) -> CameraEstimate {
    let size = frame.image_size_px;
    let prior = fuse_prior(options, size);
    let fuse_options = FuseOptions { prior, ..FuseOptions::for_image(size) };
    unobservable(&fuse_options, [frame.time_s; 2], size)
}

fn solve_window(
    window: &Window,
    atlas: &ShapeAtlas,
    size: ImageSize,
    options: &SceneOptions,
    config: &Config,
) -> Option<WindowEstimate> {
    let mut links: Vec<_> = window.views.iter().map(|view| view.link).collect();
    links.sort_unstable();
    links.dedup();
    let mut views: Vec<CarView<'_>> = window
        .views
        .iter()
        .map(|view| CarView {
            keypoints: &view.keypoints,
            group: links.binary_search(&view.link).unwrap_or(0),
            weight: view.weight,
        })
        .collect();
    let mut solution = solve_scene(atlas, size, &views, options);
    // What the plane makes of a box that holds no car shows only once the plane is known: leave it out and solve again.
    let camera = Camera::centred(solution.params.focal_px(), size);
    let believed: Vec<bool> = window
        .views
        .iter()
        .zip(&solution.cars)
        .map(|(view, car)| {
            car.as_ref().is_some_and(|car| {
                let projected = projected_box(atlas, &camera, &car.camera_from_car, &car.shape);
                is_believable(projected, &view.bbox_px, car.reprojection_rms_px, size, config)
            })
        })
        .collect();
    let mut kept: Vec<&View> = window.views.iter().collect();
    if solution.status.usable() && believed.contains(&false) && believed.contains(&true) {
        let mut flags = believed.iter();
        views.retain(|_| flags.next() == Some(&true));
        kept = window
            .views
            .iter()
            .zip(&believed)
            .filter(|(_, believed)| **believed)
            .map(|(view, _)| view)
            .collect();
        let warm = SceneOptions { start: Some(solution.params), ..*options };
        solution = solve_scene(atlas, size, &views, &warm);
    }
    tracing::debug!(
        status = ?solution.status, views = views.len(), cars = links.len(),
        focal_px = solution.params.focal_px(), tilt_deg = solution.params.tilt.to_degrees(),
        height_m = solution.params.log_height.exp(), "window solved"
    );
    if !solution.status.usable() {
        return None;
    }
    let used = kept.iter().zip(&solution.cars).filter(|(_, car)| car.as_ref().is_some_and(|c| c.used));
    let mut cars: Vec<CarUse> =
        used.map(|(view, _)| CarUse { link: view.link, parked: view.parked }).collect();
    cars.sort_by_key(|car| car.link);
    cars.dedup_by_key(|car| car.link);
    // What the cars alone say: the solve's prior is taken out again, since it is counted once over all windows.
    let alone = solution
        .information
        .cholesky()
        .map(|information| CameraParams::from_vector(&information.solve(&solution.information_vector)))
        .filter(|params| near(params, &solution.params, &solution.covariance));
    Some(WindowEstimate {
        span_s: window.span_s,
        frames: window.frames,
        params: alone.unwrap_or(solution.params),
        information: solution.information,
        cars,
        segment: window.segment,
        start: window.start,
        steady: window.steady,
    })
}

/// Whether taking the prior out moved the estimate by no more than a linearisation bears.
fn near(a: &CameraParams, b: &CameraParams, covariance: &Matrix4<f64>) -> bool {
    let step = a.to_vector() - b.to_vector();
    (0..4).all(|i| step[i].is_finite() && step[i].abs() <= 2.0 * covariance[(i, i)].max(0.0).sqrt() + 1e-9)
}

fn fuse_prior(options: &SceneOptions, size: ImageSize) -> FusePrior {
    let prior = &options.camera_prior;
    let mut params = prior.mean(size);
    let mut sd = Vector4::new(prior.log_focal_sd, prior.tilt_sd, prior.roll_sd, prior.log_height_sd);
    if let Some(focal_px) = options.known_focal_px {
        params.log_focal = focal_px.ln();
        sd[0] = GIVEN_LOG_FOCAL_SD;
    }
    FusePrior { params, sd }
}

fn unobservable(options: &FuseOptions, span_s: [f64; 2], size: ImageSize) -> CameraEstimate {
    CameraEstimate {
        span_s,
        image_size_px: size,
        principal_point_px: options.principal_point_px,
        params: options.prior.params,
        covariance: Matrix4::from_diagonal(&options.prior.sd.map(|sd| sd * sd)),
        status: CameraStatus::Unobservable,
        cars_used: 0,
        frames_used: 0,
    }
}
