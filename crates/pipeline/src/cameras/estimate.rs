//! Estimates the camera of a clip from all its frames.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::{CameraEstimate, FrameRecord, ImageSize, Lens, Registration, ShapeAtlas};
use roadplane_calibrate::{
    Cues, EvidenceBuilder, FuseOptions, Joined, SceneLines, Turns, Window, WindowEstimate, epochs, fuse, join,
};
use roadplane_measure::usable;
use roadplane_write::FrameReader;

use crate::cameras::camera_track::{CameraTrack, Visit, by_visits, position_at, positions};
use crate::cameras::empty_scene_view::EmptySceneView;
use crate::cameras::joining::{factors_by_position, fuse_options};
use crate::cameras::known::CameraConstraints;
use crate::cameras::lens::LensOfClip;
use crate::cameras::memory::{CameraHistory, look};
use crate::cameras::optics::Optics;
use crate::cameras::remembered::{add_remembered, evidence_of, own_epoch};
use crate::cameras::window::Solving;
use crate::{Config, PipelineError};

/// Estimates the lens and the places of a clip from a file of frames.
///
/// The cars of the first window check a lens that comes from edges: their focal length must suit it.
///
/// # Errors
/// As for [`Optics::of`] and [`estimate_cameras`].
pub(crate) fn optics_of(
    frames: &Path,
    known: &CameraConstraints,
    recall: Option<&CameraHistory>,
    atlas: &ShapeAtlas,
    config: &Config,
) -> Result<Optics, PipelineError> {
    let optics = Optics::of(frames, known, recall, config)?;
    // With a given focal length, the edges were already tested with it.
    let is_open = |lens: &&LensOfClip| lens.is_of_edges && known.focal_px().is_none();
    let Some(lens) = optics.lens.as_ref().filter(is_open) else { return Ok(optics) };
    let first = within(FrameReader::open(frames)?, config.calibrate.window_s);
    let first = optics.convert(first.map(|frame| frame.map_err(PipelineError::from)));
    let (known, _) = known.with_frames(&BTreeMap::new());
    let cameras = estimate_cameras(first, &optics, atlas, &known, None, None, config)?;
    let Some(camera) = cameras.estimates.first() else { return Ok(optics) };
    if lens.suits(camera) {
        return Ok(optics);
    }
    tracing::info!("the lens distortion is dropped: no lens of the estimated focal length has it");
    Optics::with_lens(lens.clone().without_distortion(), frames)
}

/// Estimates the camera from all frames, its lens and motion, user constraints and the camera database. `scene` says
/// how the picture of the empty scene lies on the picture of an earlier frame.
///
/// If nothing can be estimated the result has the status "unobservable".
///
/// # Errors
/// Any error of reading a frame; [`PipelineError::Usage`] where constraints belong to other pictures.
pub(crate) fn estimate_cameras(
    frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
    optics: &Optics,
    atlas: &ShapeAtlas,
    known: &CameraConstraints,
    recall: Option<&CameraHistory>,
    scene: Option<&Registration>,
    config: &Config,
) -> Result<CameraTrack, PipelineError> {
    let lens = optics.lens.as_ref().map_or(Lens::STRAIGHT, |of_clip| of_clip.lens);
    let mut known = known.clone();
    let mut builder = EvidenceBuilder::new(config.calibrate.window_s);
    let mut solving = Solving::new(atlas, config);
    let mut visits: Vec<Visit> = Vec::new();
    let mut size = None;
    let mut span_s = [f64::INFINITY, f64::NEG_INFINITY];
    let mut frame_count = 0;
    let mut scene_lines = SceneLines::default();
    let mut take = |window: Option<Window>, size: ImageSize, lens: Lens, known: &CameraConstraints| {
        let Some(window) = window else { return };
        match visits.last_mut() {
            Some(visit) if visit.position == window.segment => visit.span_s[1] = window.span_s[1],
            _ => visits.push(Visit { position: window.segment, span_s: window.span_s }),
        }
        solving.solve(&window, size, lens, known.focal_px());
    };
    for frame in frames {
        let mut frame = frame?;
        if size.is_none() {
            known = known.for_pictures(frame.image_size_px)?.seen_through(lens);
        }
        let image_size = *size.get_or_insert(frame.image_size_px);
        span_s = [span_s[0].min(frame.time_s), span_s[1].max(frame.time_s)];
        frame_count += 1;
        scene_lines.take(&mut frame);
        for car in &mut frame.cars {
            if let Some(set) = &mut car.keypoints {
                **set = usable(set, config.solve.min_keypoint_score);
            }
        }
        take(builder.push(frame), image_size, lens, &known);
    }
    let (Some(size), Some(of_clip)) = (size, &optics.lens) else {
        return Ok(CameraTrack { visits, ..CameraTrack::default() });
    };
    take(builder.finish(), size, lens, &known);
    let position = visits.last().map_or(0, |visit| visit.position);
    let positions = positions(&visits);
    let (mut windows, parked) = (solving.windows, solving.parked);
    let mut options = of_clip.count(&windows, fuse_options(size, positions, &known, config));
    let empty_scene = EmptySceneView::of(scene, &optics.places, position, size);
    let evidence = recall.and_then(|recall| {
        let options = options.for_cars();
        let view = empty_scene.as_ref()?;
        let (said, cars) = evidence_of(recall, &windows, position, span_s, &parked, view, &options)?;
        let epochs = epochs(&recall.evidence, &look, &options);
        if let Some(epoch) = own_epoch(recall, &said, &epochs, &options) {
            add_remembered(&mut windows, position, epoch, (&said, &cars), view);
        }
        Some(said)
    });
    let turns: BTreeMap<usize, Turns> = optics.places.turns().collect();
    if windows.is_empty() && !(known.is_silent() && turns.is_empty()) {
        windows.push(WindowEstimate::without_cars(&options, span_s, 0));
    }
    let position_at = |time_s: f64| position_at(&visits, time_s);
    let lines =
        if config.solve.use_verticals { scene_lines.by_position(position_at) } else { BTreeMap::new() };
    let cues = Cues { lines, turns }.evaluate(&windows, &options);
    for view in &cues {
        view.add_factors(&mut options.factors);
    }
    let Joined { estimates, segments, size_of_cars } = join(&windows, &options);
    let mut estimates = by_visits(estimates, &segments, &visits);
    if estimates.is_empty() {
        estimates.push(options.unobservable(span_s));
        tracing::warn!("the camera cannot be estimated from the cars of {frame_count} frames");
    }
    let constraints = known.checked(size, |others| {
        let mut factors = factors_by_position(size, positions, others);
        for view in &cues {
            view.add_factors(&mut factors);
        }
        fuse(&windows, &FuseOptions { factors, ..options.clone() }).into_iter().next()
    });
    Ok(CameraTrack { estimates, visits, evidence, size_of_cars, constraints, scene: cues, empty_scene })
}

/// Returns the camera before any car is used: the prior and the user constraints.
#[must_use]
pub fn prior_camera(known: &CameraConstraints, frame: &FrameRecord, config: &Config) -> CameraEstimate {
    let (size, span_s) = (frame.image_size_px, [frame.time_s; 2]);
    let options = fuse_options(size, 1, known, config);
    let told = (!known.is_silent()).then(|| WindowEstimate::without_cars(&options, span_s, 0));
    fuse(told.as_slice(), &options).pop().unwrap_or_else(|| options.unobservable(span_s))
}

/// Returns the frames of the first `span_s` seconds.
fn within<E>(
    frames: impl Iterator<Item = Result<FrameRecord, E>>,
    span_s: f64,
) -> impl Iterator<Item = Result<FrameRecord, E>> {
    let mut end_s = None;
    frames.take_while(move |frame| {
        let time_s = frame.as_ref().map_or(f64::NEG_INFINITY, |frame| frame.time_s);
        time_s <= *end_s.get_or_insert(time_s + span_s)
    })
}
