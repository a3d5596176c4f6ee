//! The camera of a clip: windows of views → joint solves, what is remembered → one estimate per stretch of time.

pub(crate) mod known;
pub(crate) mod krtd;
pub(crate) mod lens;
pub(crate) mod memory;

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Matrix4, Vector4};
use roadplane_base::{
    Camera, CameraEstimate, CameraEvidence, CameraParams, CameraStatus, Clue, EVIDENCE_SCHEMA, FrameRecord,
    ImageSize, JointInformation, KeypointSet, Lens, ParkedCar, SceneCurve, ShapeAtlas,
};
use roadplane_calibrate::{
    CarUse, Epoch, EvidenceBuilder, EvidenceOptions, FuseOptions, FusePrior, Joined, LinkId, SegmentStart,
    View, Window, WindowEstimate, condense, epochs, fuse, join, joins, same_vehicle,
};
use roadplane_geo::{Place, Site};
use roadplane_solve::{CarView, SceneOptions, SceneSolution, SceneStatus, solve_scene};
use roadplane_write::KnownSummary;

use crate::cameras::lens::LensOfClip;
use crate::cameras::memory::{Recall, look};
use crate::stream::scene_lines::{SceneView, ToldLines, and_verticals, hear_witnesses};
use crate::tracks::believe::{is_believable, projected_box};
use crate::{Config, Known, PipelineError};

/// sd of log focal that stands for "given".
const GIVEN_LOG_FOCAL_SD: f64 = 1e-6;
/// sd of the mean size of a place's cars against the shape atlas', log: those of the USA are some 6 % longer than Europe's,
/// Japan's as much shorter (estimates). Every car of a clip shares it, and heights and distances scale with it.
pub(crate) const POPULATION_LOG_SD: f64 = 0.04;

/// The camera at every time of a clip.
#[derive(Clone, Debug, Default)]
pub struct CameraTrack {
    estimates: Vec<CameraEstimate>,
    /// When each position of the camera after the first began, s.
    moves_s: Vec<f64>,
    said: Option<CameraEvidence>,
    size_of_cars: f64,
    known: Vec<KnownSummary>,
    scene: Vec<SceneView>,
}

/// Links of remembered vehicles are this and above; a clip counts its own from 0.
const REMEMBERED: LinkId = 1 << 48;

impl CameraTrack {
    /// Of estimates that were read back.
    #[must_use]
    pub fn from_estimates(estimates: Vec<CameraEstimate>) -> Self {
        Self { estimates, ..Self::default() }
    }

    /// What the clip alone says of its camera, for other clips to start from; where asked for, and where it says something.
    #[must_use]
    pub fn said(&self) -> Option<&CameraEvidence> {
        self.said.as_ref()
    }

    /// Log of how large the place's cars are against the atlas; 0 where nothing but cars tells scale.
    #[must_use]
    pub fn size_of_cars(&self) -> f64 {
        self.size_of_cars
    }

    /// What was told of the camera, against everything else.
    #[must_use]
    pub fn known(&self) -> &[KnownSummary] {
        &self.known
    }

    /// Lines of the scene and what they came to, by the camera's position.
    #[must_use]
    pub fn scene(&self) -> &[SceneView] {
        &self.scene
    }

    /// How often it was moved.
    #[must_use]
    pub fn moves(&self) -> usize {
        self.moves_s.len()
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

/// Estimates the camera from all frames, long edges of the place, and what is remembered of it, or says that nothing could be estimated.
///
/// # Errors
/// Whatever reading a frame failed with; [`PipelineError::Usage`] where what is known is of other pictures.
pub fn estimate_cameras(
    frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
    curves: &[SceneCurve],
    atlas: &ShapeAtlas,
    known: &Known,
    recall: Option<&Recall>,
    config: &Config,
) -> Result<CameraTrack, PipelineError> {
    let mut known = known.clone();
    let mut lens: Option<LensOfClip> = None;
    let mut builder = EvidenceBuilder::new(EvidenceOptions {
        window_s: config.calibrate.window_s,
        ..EvidenceOptions::default()
    });
    // What is remembered, and what is held against the user, comes of solves that were not told.
    let mut untold = Solving::new(atlas, config);
    let mut told: Option<Solving<'_>> = None;
    let mut moves_s: Vec<f64> = Vec::new();
    let mut size = None;
    let mut span_s = [f64::INFINITY, f64::NEG_INFINITY];
    let mut frame_count = 0;
    let mut scene_lines = ToldLines::default();
    let mut take = |window: Option<Window>, size: ImageSize, lens: Lens, known: &Known| {
        let Some(window) = window else { return };
        if window.segment > moves_s.len() {
            moves_s.push(window.span_s[0]);
        }
        let focal_px = known.focal_px();
        let clues = clues_of_window(&known.clues(moves_s.len(), size));
        if told.is_none() && !clues.is_empty() {
            told = Some(untold.clone());
        }
        untold.solve(&window, size, lens, focal_px, Arc::new([]));
        if let Some(told) = &mut told {
            told.solve(&window, size, lens, focal_px, clues);
        }
    };
    for frame in frames {
        let mut frame = frame?;
        if size.is_none() {
            known = known.for_pictures(frame.image_size_px)?;
        }
        let image_size = *size.get_or_insert(frame.image_size_px);
        let lens = lens.get_or_insert_with(|| {
            let lens = LensOfClip::new(curves, image_size, &known, recall, config);
            known = known.seen_through(lens.lens());
            lens
        });
        span_s = [span_s[0].min(frame.time_s), span_s[1].max(frame.time_s)];
        frame_count += 1;
        scene_lines.take(&mut frame);
        for car in &mut frame.cars {
            if let Some(set) = &mut car.keypoints {
                **set = usable(set, config);
            }
        }
        take(builder.push(frame), image_size, lens.lens(), &known);
    }
    let (Some(size), Some(lens)) = (size, lens) else {
        return Ok(CameraTrack { moves_s, ..CameraTrack::default() });
    };
    take(builder.finish(), size, lens.lens(), &known);
    let position = moves_s.len();
    let (mut untold, parked) = (untold.windows, untold.parked);
    let mut fuse_options = lens.count(&untold, fuse_options(size, position, &known, config));
    let mut told = told.map(|solving| solving.windows);
    let said = recall.and_then(|recall| {
        let options = fuse_options.for_cars();
        let (said, links) = evidence_of(recall, &untold, position, span_s, &parked, &options)?;
        let epochs = epochs(&recall.evidence, &look, &options);
        if let Some(epoch) = own_epoch(recall, &said, &epochs, &options) {
            for windows in told.iter_mut().chain([&mut untold]) {
                add_remembered(windows, position, epoch, &said, &links);
            }
        }
        Some(said)
    });
    if !known.is_silent() {
        for windows in told.iter_mut().chain([&mut untold]).filter(|windows| windows.is_empty()) {
            windows.push(nothing_seen(&fuse_options, span_s, 0));
        }
    }
    let mut scene = Vec::new();
    if config.solve.use_verticals {
        let position_at = |time_s: f64| moves_s.iter().filter(|from_s| **from_s <= time_s).count();
        let lines = scene_lines.by_position(position_at);
        if let Some(told) = &mut told {
            hear_witnesses(&mut untold, &lines, &mut fuse_options.for_cars());
            scene = hear_witnesses(told, &lines, &mut fuse_options);
        } else {
            scene = hear_witnesses(&mut untold, &lines, &mut fuse_options);
        }
    }
    let Joined { mut estimates, size_of_cars } = join(told.as_ref().unwrap_or(&untold), &fuse_options);
    if estimates.is_empty() {
        estimates.push(unobservable(&fuse_options, span_s, size));
        tracing::warn!("the camera cannot be estimated from the cars of {frame_count} frames");
    }
    let known = known.checked(size, |others| {
        let mut clues = clues_by_position(size, position, others);
        and_verticals(&mut clues, &scene);
        fuse(&untold, &FuseOptions { clues, ..fuse_options.clone() }).into_iter().next()
    });
    Ok(CameraTrack { estimates, moves_s, said, size_of_cars, known, scene })
}

/// The windows of a clip as they are solved, each from where the one before ended.
#[derive(Clone)]
struct Solving<'a> {
    atlas: &'a ShapeAtlas,
    config: &'a Config,
    start: Option<CameraParams>,
    windows: Vec<WindowEstimate>,
    parked: BTreeMap<LinkId, ParkedCar>,
}

impl<'a> Solving<'a> {
    fn new(atlas: &'a ShapeAtlas, config: &'a Config) -> Self {
        Self { atlas, config, start: None, windows: Vec::new(), parked: BTreeMap::new() }
    }

    fn solve(
        &mut self,
        window: &Window,
        size: ImageSize,
        lens: Lens,
        focal_px: Option<f64>,
        clues: Arc<[Clue]>,
    ) {
        let options =
            SceneOptions { start: self.start, clues, lens, ..self.config.solve.scene_options(focal_px) };
        if let Some(solved) = solve_window(window, self.atlas, size, &options, self.config) {
            self.start = Some(solved.estimate.params);
            self.parked.extend(solved.parked);
            self.windows.push(solved.estimate);
        }
    }
}

/// How windows, and clips, are joined by this configuration, where the camera was moved so often.
pub(crate) fn fuse_options(size: ImageSize, moves: usize, known: &Known, config: &Config) -> FuseOptions {
    let options = config.solve.scene_options(known.focal_px());
    FuseOptions {
        focal_given: known.focal_px().is_some(),
        prior: fuse_prior(&options, size),
        shared_sd: options.shared_sd(),
        clues: clues_by_position(size, moves, known),
        size_of_cars_sd: POPULATION_LOG_SD,
        ..FuseOptions::for_image(size)
    }
}

/// All that speaks of the camera beside cars, by its position.
fn clues_by_position(size: ImageSize, moves: usize, known: &Known) -> BTreeMap<usize, Arc<[Clue]>> {
    let clues = (0..=moves).map(|position| (position, Arc::from(known.clues(position, size))));
    clues.filter(|(_, clues): &(usize, Arc<[Clue]>)| !clues.is_empty()).collect()
}

/// What of that a window is solved with: its cars take themselves for as large as the atlas', which only many windows together can
/// weigh against a length.
fn clues_of_window(clues: &[Clue]) -> Arc<[Clue]> {
    clues.iter().filter_map(Clue::without_scale).collect()
}

/// A window without cars.
fn nothing_seen(options: &FuseOptions, span_s: [f64; 2], segment: usize) -> WindowEstimate {
    WindowEstimate {
        span_s,
        frames: 0,
        params: options.prior.params,
        solved: options.prior.params,
        joint: JointInformation::none(),
        cars: Vec::new(),
        segment,
        start: SegmentStart::Clip,
        steady: true,
    }
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
    let together = condense(&last, options).unwrap_or_else(|| nothing_seen(options, clip_span_s, position));
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
        information: std::array::from_fn(|r| std::array::from_fn(|c| together.joint.information[(r, c)])),
        shared: std::array::from_fn(|r| std::array::from_fn(|c| together.joint.cross[(r, c)])),
        lens: options.bend_sd.map(|sd| (options.lens, Lens::with_bend(sd, options.image_size_px).per_px2)),
        moving: together.cars.len() - stood.len(),
        parked: stood,
        place: recall.place.clone(),
    };
    Some((said, links))
}

/// The epoch that this clip belongs to; none where it begins one. Says which.
fn own_epoch<'a, 'b>(
    recall: &Recall,
    said: &CameraEvidence,
    epochs: &'b [Epoch<'a>],
    options: &FuseOptions,
) -> Option<&'b Epoch<'a>> {
    let camera = &recall.camera;
    let epoch = joins(said, epochs, &look, options).map(|index| &epochs[index]);
    match epoch {
        Some(epoch) => tracing::info!("camera {camera}: {} clips are remembered", epoch.clips.len()),
        None if epochs.is_empty() => {}
        None => {
            tracing::info!("camera {camera}: it was moved since it was last seen, a new epoch begins");
        }
    }
    epoch
}

/// Puts what other clips said of the camera's last position in front of this clip's windows of it, and links the vehicles that
/// stand there as they stood before.
fn add_remembered(
    windows: &mut Vec<WindowEstimate>,
    position: usize,
    epoch: &Epoch<'_>,
    said: &CameraEvidence,
    links: &[LinkId],
) {
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
    known: &Known,
    config: &Config,
) -> CameraEstimate {
    let size = frame.image_size_px;
    let curves = frame.scene_curves.as_deref().unwrap_or_default();
    let lens = LensOfClip::new(curves, size, known, None, config);
    let known = &known.seen_through(lens.lens());
    let mut options = config.solve.scene_options(known.focal_px());
    options.lens = lens.lens();
    options.clues = clues_of_window(&known.clues(0, size));
    let sets: Vec<KeypointSet> =
        frame.cars.iter().filter_map(|car| car.keypoints.as_deref()).map(|set| usable(set, config)).collect();
    let views: Vec<CarView<'_>> =
        sets.iter().enumerate().map(|(group, keypoints)| CarView { keypoints, group, weight: 1.0 }).collect();
    let solution = solve_scene(atlas, size, &views, &options);
    let cars_used = solution.cars.iter().flatten().filter(|car| car.used).count();
    if !known.is_silent() {
        let fuse_options = lens.count(&[], fuse_options(size, 0, known, config));
        let silent = nothing_seen(&fuse_options, [frame.time_s; 2], 0);
        let window = if solution.status.usable() {
            let (params, joint) = by_cars_alone(&solution);
            WindowEstimate { params, solved: solution.params, joint, ..silent }
        } else {
            silent
        };
        let frames_used = usize::from(cars_used > 0);
        if let Some(estimate) = fuse(&[window], &fuse_options).pop() {
            return CameraEstimate { cars_used, frames_used, ..estimate };
        }
    }
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
        lens: lens.lens(),
        bend_sd: lens.bend_sd(),
        params: solution.params,
        covariance: solution.covariance,
        status,
        cars_used,
        frames_used: usize::from(cars_used > 0),
    }
}

/// The camera before any car is looked at.
#[must_use]
pub fn prior_camera(known: &Known, frame: &FrameRecord, config: &Config) -> CameraEstimate {
    let (size, span_s) = (frame.image_size_px, [frame.time_s; 2]);
    let options = fuse_options(size, 0, known, config);
    let told = (!known.is_silent()).then(|| nothing_seen(&options, span_s, 0));
    fuse(told.as_slice(), &options).pop().unwrap_or_else(|| unobservable(&options, span_s, size))
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
    let camera = Camera { lens: options.lens, ..Camera::centred(solution.params.focal_px(), size) };
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
        let warm = SceneOptions { start: Some(solution.params), ..options.clone() };
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
    let (params, joint) = by_cars_alone(&solution);
    let estimate = WindowEstimate {
        span_s: window.span_s,
        frames: window.frames,
        params,
        solved: solution.params,
        joint,
        cars,
        segment: window.segment,
        start: window.start,
        steady: window.steady,
    };
    let parked = used.iter().filter(|view| view.parked).map(|view| (view.link, parked_car(view))).collect();
    Some(SolvedWindow { estimate, parked })
}

/// What the cars alone say: the solve's prior and clues are taken out again, since they are counted once over all windows.
fn by_cars_alone(solution: &SceneSolution) -> (CameraParams, JointInformation) {
    let joint = solution.information;
    let alone = joint.information.cholesky().map(|i| CameraParams::from_vector(&i.solve(&joint.vector)));
    let alone = alone.filter(|params| near(params, &solution.params, &solution.covariance));
    let params = alone.unwrap_or(solution.params);
    (params, JointInformation { vector: joint.information * params.to_vector(), ..joint })
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
        lens: options.lens,
        bend_sd: options.bend_sd,
        params: options.prior.params,
        covariance: Matrix4::from_diagonal(&options.prior.sd.map(|sd| sd * sd)),
        status: CameraStatus::Unobservable,
        cars_used: 0,
        frames_used: 0,
    }
}
