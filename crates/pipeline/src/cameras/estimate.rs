//! Estimates the camera of a clip from all its frames.

use std::collections::BTreeMap;
use std::path::Path;

use roadplane_base::{
    CameraEstimate, FrameRecord, ImageSize, Lens, ParkedCar, Registration, SceneLine, ShapeAtlas, bbox_foot,
};
use roadplane_calibrate::{
    CarIdentity, EvidenceBuilder, Fold, FuseOptions, GroundEvidence, Joined, Window, WindowEstimate, cues,
    epochs, join,
};
use roadplane_measure::usable;
use roadplane_write::FrameReader;

use crate::cameras::camera_track::{CameraTrack, Visit, by_visits};
use crate::cameras::database::{CameraHistory, compare_views};
use crate::cameras::empty_scene_view::scene_from_world;
use crate::cameras::joining::{factors_by_position, fuse_options};
use crate::cameras::known::CameraConstraints;
use crate::cameras::lens::LensOfClip;
use crate::cameras::optics::Optics;
use crate::cameras::second_plane::with_second_plane;
use crate::cameras::stored::{add_stored, evidence_of, own_epoch};
use crate::cameras::window::Solving;
use crate::{Config, PipelineError};

/// Estimates the lens and the places of a clip from a file of frames.
///
/// The cars of the first window check a lens that comes from edges: their focal length must suit it.
///
/// # Errors
/// As for [`Optics::of`] and [`CameraInputs::estimate`].
pub(crate) fn optics_of(
    frames: &Path,
    known: &CameraConstraints,
    history: Option<&CameraHistory>,
    atlas: &ShapeAtlas,
    config: &Config,
) -> Result<Optics, PipelineError> {
    let optics = Optics::of(frames, known, history, config)?;
    // With a given focal length, the edges were already tested with it.
    let is_open = |lens: &&LensOfClip| lens.is_of_clip && known.focal_px().is_none();
    let Some(lens) = optics.lens.as_ref().filter(is_open) else { return Ok(optics) };
    let first = || -> Result<_, PipelineError> {
        let first = within(FrameReader::open(frames)?, config.calibrate.window_s);
        Ok(optics.convert(first.map(|frame| frame.map_err(PipelineError::from))))
    };
    let (known, _) = known.with_frames(&BTreeMap::new());
    let inputs = CameraInputs {
        optics: &optics,
        atlas,
        known: &known,
        history: None,
        scene: None,
        may_fold: false,
        config,
    };
    let cameras = inputs.estimate(first)?;
    let Some(camera) = cameras.estimates.first() else { return Ok(optics) };
    if lens.suits(camera) {
        return Ok(optics);
    }
    tracing::info!("the lens distortion is dropped: no lens of the estimated focal length has it");
    Optics::with_lens(lens.clone().without_distortion(), frames)
}

/// Evidence on the camera of a clip other than its frames.
pub(crate) struct CameraInputs<'a> {
    /// Lens of the clip, and the motion of its camera.
    pub optics: &'a Optics,
    pub atlas: &'a ShapeAtlas,
    pub known: &'a CameraConstraints,
    /// Evidence of the camera's other clips.
    pub history: Option<&'a CameraHistory>,
    /// How the picture of the empty scene lies on the picture of an earlier frame.
    pub scene: Option<&'a Registration>,
    /// Whether the ground may be two planes. Surveyed points require one plane.
    pub may_fold: bool,
    pub config: &'a Config,
}

impl CameraInputs<'_> {
    /// Estimates the camera from all frames and the other evidence. `frames` opens the clip's frames; if the ground is
    /// not one plane, they are read twice.
    ///
    /// If nothing can be estimated the result has the status "unobservable".
    ///
    /// # Errors
    /// Any error of reading a frame; [`PipelineError::Usage`] where constraints belong to other pictures.
    pub(crate) fn estimate<I>(
        &self,
        frames: impl Fn() -> Result<I, PipelineError>,
    ) -> Result<CameraTrack, PipelineError>
    where
        I: Iterator<Item = Result<FrameRecord, PipelineError>>,
    {
        let clip = self.solve(frames()?, None)?;
        // The planes of a moved camera are not followed from one position to the next.
        let may_fold = self.may_fold && clip.visits.len() == 1 && self.known.is_silent();
        let fold = if may_fold { clip.ground.fold() } else { None };
        if let Some(Fold { log_evidence, angle_rad, .. }) = fold {
            tracing::debug!(log_evidence, angle_deg = angle_rad.to_degrees(), "evidence for a second plane");
        }
        if let Some(fold) = fold.filter(Fold::is_certain) {
            if let Some(cameras) = self.join(self.solve(frames()?, Some(&fold))?, Some(&fold)) {
                let slope_rad = cameras.estimates.first().and_then(CameraEstimate::slope_rad).unwrap_or(0.0);
                tracing::info!(
                    "the ground is two planes, and its slope changes by {:.1} %",
                    100.0 * slope_rad.tan()
                );
                return Ok(cameras);
            }
            tracing::info!("the ground may be two planes, but the cars do not determine them");
        }
        Ok(self.join(clip, None).unwrap_or_default())
    }

    /// Solves the windows of a clip.
    fn solve(
        &self,
        frames: impl Iterator<Item = Result<FrameRecord, PipelineError>>,
        fold: Option<&Fold>,
    ) -> Result<ClipWindows, PipelineError> {
        let lens = self.optics.lens.as_ref().map_or(Lens::STRAIGHT, |of_clip| of_clip.lens);
        let mut known = self.known.clone();
        let mut builder = EvidenceBuilder::new(self.config.calibrate.window_s);
        let mut solving = Solving::new(self.atlas, self.config);
        let mut visits: Vec<Visit> = Vec::new();
        let mut size = None;
        let mut span_s = [f64::INFINITY, f64::NEG_INFINITY];
        let mut frame_count = 0;
        let mut scene_lines = BTreeMap::new();
        let mut take = |window: Option<Window>, size: ImageSize, known: &CameraConstraints| {
            let Some(window) = window else { return };
            match visits.last_mut() {
                Some(visit) if visit.position == window.position => visit.span_s[1] = window.span_s[1],
                _ => visits.push(Visit { position: window.position, span_s: window.span_s }),
            }
            let foot_px = |bbox_px: &[f64; 4]| lens.undistorted(&(bbox_foot(bbox_px) - size.centre_px()));
            match fold {
                Some(fold) => window.divided(fold, foot_px).iter().for_each(|window| {
                    solving.solve(window, size, lens, known.focal_px());
                }),
                None => solving.solve(&window, size, lens, known.focal_px()),
            }
        };
        for frame in frames {
            let mut frame = frame?;
            if size.is_none() {
                known = known.for_pictures(frame.image_size_px)?.seen_through(lens);
            }
            let image_size = *size.get_or_insert(frame.image_size_px);
            span_s = [span_s[0].min(frame.time_s), span_s[1].max(frame.time_s)];
            frame_count += 1;
            for car in &mut frame.cars {
                if let Some(set) = &mut car.keypoints {
                    **set = usable(set, self.config.solve.min_keypoint_score);
                }
            }
            take(builder.push(&frame), image_size, &known);
            if let Some(lines) = frame.scene_lines {
                scene_lines.insert(builder.position, lines);
            }
        }
        if let Some(size) = size {
            take(builder.finish(), size, &known);
        }
        let Solving { windows, parked, ground, .. } = solving;
        Ok(ClipWindows { windows, parked, ground, visits, size, span_s, frame_count, scene_lines, known })
    }

    /// Joins the windows of a clip with all other evidence. Returns `None` if the cars do not determine the planes on
    /// both sides of the fold.
    fn join(&self, clip: ClipWindows, fold: Option<&Fold>) -> Option<CameraTrack> {
        let Self { optics, config, .. } = *self;
        let ClipWindows { mut windows, parked, visits, span_s, known, .. } = clip;
        let (Some(size), Some(of_clip)) = (clip.size, &optics.lens) else {
            return Some(CameraTrack { visits, ..CameraTrack::default() });
        };
        let position = visits.last().map_or(0, |visit| visit.position);
        // The camera may end at an earlier position.
        let positions = visits.iter().map(|visit| visit.position + 1).max().unwrap_or(1);
        let mut options = of_clip.count(&windows, fuse_options(size, positions, &known, config));
        let scene_from_world = scene_from_world(self.scene, &optics.places, position, size);
        let evidence = self.history.and_then(|history| {
            let options = options.for_cars();
            let motion = scene_from_world.as_ref()?;
            let (said, cars) = evidence_of(history, &windows, position, span_s, &parked, motion, &options)?;
            let epochs = epochs(&history.evidence, &compare_views, &options);
            if let Some(epoch) = own_epoch(history, &said, &epochs, &options) {
                add_stored(&mut windows, position, epoch, (&said, &cars), motion);
            }
            Some(said)
        });
        if windows.is_empty() && !(known.is_silent() && optics.places.turns.is_empty()) {
            windows.push(WindowEstimate::without_cars(&options, span_s, 0));
        }
        let lines = if config.solve.use_verticals { clip.scene_lines } else { BTreeMap::new() };
        let cues = cues(lines, &optics.places.turns, &windows, &options);
        for cue in &cues {
            cue.add_factors(&mut options.factors);
        }
        options.is_folded = fold.is_some();
        let joined = join(&windows, &options);
        let Joined { estimates, size_of_cars } = match fold {
            Some(fold) => with_second_plane(fold, joined)?,
            None => joined,
        };
        let mut estimates = by_visits(&estimates, &visits);
        if estimates.is_empty() {
            estimates.push(options.unobservable(span_s));
            tracing::warn!("the camera cannot be estimated from the cars of {} frames", clip.frame_count);
        }
        let (constraints, not_compared) = known.checked(size, |others| {
            let mut factors = factors_by_position(size, positions, others);
            for cue in &cues {
                cue.add_factors(&mut factors);
            }
            join(&windows, &FuseOptions { factors, ..options.clone() }).estimates
        });
        Some(CameraTrack {
            estimates,
            visits,
            evidence,
            size_of_cars,
            constraints,
            not_compared,
            scene: cues,
            scene_from_world,
        })
    }
}

/// The solved windows of a clip, with the size, times and scene lines of its frames.
struct ClipWindows {
    windows: Vec<WindowEstimate>,
    /// Parked vehicles of all windows.
    parked: BTreeMap<CarIdentity, ParkedCar>,
    ground: GroundEvidence,
    visits: Vec<Visit>,
    /// Size of the pictures; `None` without frames.
    size: Option<ImageSize>,
    /// Time of the first and the last frame, s.
    span_s: [f64; 2],
    frame_count: usize,
    /// The last lines of each camera position.
    scene_lines: BTreeMap<usize, Vec<SceneLine>>,
    /// User constraints for pictures of this size and lens.
    known: CameraConstraints,
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
