//! The camera of a clip: windows of views → joint solves, what is remembered → one estimate per stretch of time.

use std::collections::BTreeMap;

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{
    Camera, CameraEstimate, CameraEvidence, CameraParams, CameraStatus, EVIDENCE_SCHEMA, FrameRecord,
    ImageSize, KeypointSet, ParkedCar, ShapeAtlas,
};
use roadplane_calibrate::{
    CarUse, EvidenceBuilder, EvidenceOptions, FuseOptions, FusePrior, LinkId, SegmentStart, View, Window,
    WindowEstimate, condense, epochs, fuse, joins, same_vehicle,
};
use roadplane_geo::{Place, Site};
use roadplane_solve::{CarView, SceneOptions, SceneStatus, solve_scene};

use crate::believe::{is_believable, projected_box};
use crate::memory::{Recall, look};
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
    said: Option<CameraEvidence>,
}

/// Links of remembered vehicles are this and above; a clip counts its own from 0.
const REMEMBERED: LinkId = 1 << 48;

impl CameraTrack {
    /// Of estimates that were read back.
    #[must_use]
    pub fn from_estimates(estimates: Vec<CameraEstimate>) -> Self {
        Self { estimates, moves_s: Vec::new(), said: None }
    }

    /// What the clip alone says of its camera, for other clips to start from; where asked for, and where it says something.
    #[must_use]
    pub fn said(&self) -> Option<&CameraEvidence> {
        self.said.as_ref()
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

    /// Puts the camera on the map; points refine it.
    ///
    /// # Errors
    /// What is wrong with the site; that the camera was moved.
    pub fn put_on_map(&mut self, site: &Site) -> Result<Place, String> {
        let [only] = self.estimates.as_mut_slice() else {
            return Err(format!(
                "the camera had {} positions, which have no one place",
                self.estimates.len()
            ));
        };
        let place = site.place(only)?;
        if matches!(site, Site::Points(_)) {
            *only = place.refined(only);
        }
        Ok(place)
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

/// Estimates the camera from all frames and what is remembered of it, or says that nothing could be estimated.
///
/// # Errors
/// Whatever reading a frame failed with.
pub fn estimate_cameras(
    frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
    atlas: &ShapeAtlas,
    known_focal_px: Option<f64>,
    recall: Option<&Recall>,
    config: &Config,
) -> Result<CameraTrack, PipelineError> {
    let mut options = config.solve.scene_options(known_focal_px);
    // Windows say what each alone would; what their cars' errors have in common is counted where they are fused.
    options.camera_dispersion = 1.0;
    let mut builder = EvidenceBuilder::new(EvidenceOptions {
        window_s: config.calibrate.window_s,
        ..EvidenceOptions::default()
    });
    let mut windows = Vec::new();
    let mut parked = BTreeMap::new();
    let mut moves_s: Vec<f64> = Vec::new();
    let mut size = None;
    let mut span_s = [f64::INFINITY, f64::NEG_INFINITY];
    let mut frame_count = 0;
    let mut take = |window: Option<Window>, size: ImageSize, options: &mut SceneOptions| {
        if let Some(window) = window.as_ref().filter(|window| window.segment > moves_s.len()) {
            moves_s.push(window.span_s[0]);
        }
        if let Some(solved) = window.and_then(|window| solve_window(&window, atlas, size, options, config)) {
            options.start = Some(solved.estimate.params);
            parked.extend(solved.parked);
            windows.push(solved.estimate);
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
        return Ok(CameraTrack { estimates: Vec::new(), moves_s, said: None });
    };
    take(builder.finish(), size, &mut options);
    let fuse_options = fuse_options(size, known_focal_px, config);
    let position = moves_s.len();
    let said = recall.and_then(|recall| {
        let (said, links) = evidence_of(recall, &windows, position, span_s, &parked, &fuse_options)?;
        add_remembered(&mut windows, position, recall, &said, &links, &fuse_options);
        Some(said)
    });
    let mut estimates = with_size_of_cars(fuse(&windows, &fuse_options));
    if estimates.is_empty() {
        estimates.push(unobservable(&fuse_options, span_s, size));
        tracing::warn!("the camera cannot be estimated from the cars of {frame_count} frames");
    }
    Ok(CameraTrack { estimates, moves_s, said })
}

/// How windows, and clips, are joined by this configuration.
pub(crate) fn fuse_options(size: ImageSize, known_focal_px: Option<f64>, config: &Config) -> FuseOptions {
    let options = config.solve.scene_options(known_focal_px);
    FuseOptions {
        focal_given: known_focal_px.is_some(),
        prior: fuse_prior(&options, size),
        dispersion: options.camera_dispersion,
        ..FuseOptions::for_image(size)
    }
}

/// Counts the error that all cars of the place share.
pub(crate) fn with_size_of_cars(mut estimates: Vec<CameraEstimate>) -> Vec<CameraEstimate> {
    for estimate in &mut estimates {
        estimate.covariance[(3, 3)] += POPULATION_LOG_SD * POPULATION_LOG_SD;
    }
    estimates
}

/// What the windows of the camera's last position say, the one that the picture of the place is of, with the links of its parked
/// vehicles. `None` where the camera drifted or was moved unseen.
fn evidence_of(
    recall: &Recall,
    windows: &[WindowEstimate],
    position: usize,
    clip_span_s: [f64; 2],
    parked: &BTreeMap<LinkId, ParkedCar>,
    options: &FuseOptions,
) -> Option<(CameraEvidence, Vec<LinkId>)> {
    let last: Vec<WindowEstimate> = windows.iter().filter(|w| w.segment == position).cloned().collect();
    if fuse(&last, options).len() > 1 {
        return None;
    }
    let together = condense(&last, options).unwrap_or_else(|| WindowEstimate {
        span_s: clip_span_s,
        frames: 0,
        params: options.prior.params,
        information: Matrix4::zeros(),
        cars: Vec::new(),
        segment: position,
        start: SegmentStart::Clip,
        steady: true,
    });
    let stood = together.cars.iter().filter(|car| car.parked);
    let (links, stood): (Vec<LinkId>, Vec<ParkedCar>) =
        stood.filter_map(|car| Some((car.link, parked.get(&car.link)?.clone()))).unzip();
    let params = together.params.to_vector();
    let said = CameraEvidence {
        schema: EVIDENCE_SCHEMA.to_owned(),
        camera: recall.camera.clone(),
        clip: recall.clip.clone(),
        models: recall.models.clone(),
        image_size_px: options.image_size_px,
        span_s: together.span_s,
        frames: together.frames,
        params: std::array::from_fn(|i| params[i]),
        information: std::array::from_fn(|r| std::array::from_fn(|c| together.information[(r, c)])),
        moving: together.cars.len() - stood.len(),
        parked: stood,
        place: recall.place.clone(),
    };
    Some((said, links))
}

/// Puts what other clips said of the camera's last position in front of this clip's windows of it, and links the vehicles that
/// stand there as they stood before. Nothing is put where this clip begins an epoch.
fn add_remembered(
    windows: &mut Vec<WindowEstimate>,
    position: usize,
    recall: &Recall,
    said: &CameraEvidence,
    links: &[LinkId],
    options: &FuseOptions,
) {
    let epochs = epochs(&recall.evidence, &look, options);
    let Some(index) = joins(said, &epochs, &look, options) else {
        if !epochs.is_empty() {
            tracing::info!(
                "camera {}: it was moved since it was last seen, a new epoch begins",
                recall.camera
            );
        }
        return;
    };
    let epoch = &epochs[index];
    tracing::info!("camera {}: {} clips are remembered", recall.camera, epoch.clips.len());
    let known = |car: &ParkedCar| epoch.vehicles.iter().find(|(_, known)| same_vehicle(known, car));
    let same: BTreeMap<LinkId, LinkId> = links
        .iter()
        .zip(&said.parked)
        .filter_map(|(link, car)| Some((*link, known(car)?.0 + REMEMBERED)))
        .collect();
    let first = windows.iter().position(|w| w.segment == position);
    let (at, from_s, start) = first.map_or((windows.len(), said.span_s[0], SegmentStart::Clip), |at| {
        (at, windows[at].span_s[0], windows[at].start)
    });
    for window in &mut windows[at..] {
        for car in &mut window.cars {
            car.link = same.get(&car.link).copied().unwrap_or(car.link);
        }
    }
    if let Some(first) = windows.get_mut(at) {
        first.steady = true;
    }
    let remembered = epoch.windows.iter().map(|window| WindowEstimate {
        span_s: [from_s; 2],
        frames: 0,
        cars: window.cars.iter().map(|car| CarUse { link: car.link + REMEMBERED, ..*car }).collect(),
        segment: position,
        start,
        ..window.clone()
    });
    windows.splice(at..at, remembered.collect::<Vec<_>>());
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

/// A window's estimate, and its vehicles that stood.
struct SolvedWindow {
    estimate: WindowEstimate,
    parked: Vec<(LinkId, ParkedCar)>,
}

fn solve_window(
    window: &Window,
    atlas: &ShapeAtlas,
    size: ImageSize,
    options: &SceneOptions,
    config: &Config,
) -> Option<SolvedWindow> {
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
    let used: Vec<&View> = used.map(|(view, _)| *view).collect();
    let mut cars: Vec<CarUse> =
        used.iter().map(|view| CarUse { link: view.link, parked: view.parked }).collect();
    cars.sort_by_key(|car| car.link);
    cars.dedup_by_key(|car| car.link);
    // What the cars alone say: the solve's prior is taken out again, since it is counted once over all windows.
    let alone = solution
        .information
        .cholesky()
        .map(|information| CameraParams::from_vector(&information.solve(&solution.information_vector)))
        .filter(|params| near(params, &solution.params, &solution.covariance));
    let estimate = WindowEstimate {
        span_s: window.span_s,
        frames: window.frames,
        params: alone.unwrap_or(solution.params),
        information: solution.information,
        cars,
        segment: window.segment,
        start: window.start,
        steady: window.steady,
    };
    let parked = used.iter().filter(|view| view.parked).map(|view| (view.link, parked_car(view))).collect();
    Some(SolvedWindow { estimate, parked })
}

/// As it is remembered, to a tenth of a pixel.
fn parked_car(view: &View) -> ParkedCar {
    let rounded = |v: f64| (v * 10.0).round() / 10.0;
    let pixel = |point: &roadplane_base::Keypoint| [rounded(point.pixel.x), rounded(point.pixel.y)];
    ParkedCar {
        bbox_px: view.bbox_px.map(rounded),
        keypoints_px: view.keypoints.iter().map(|point| point.as_ref().map(pixel)).collect(),
    }
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
