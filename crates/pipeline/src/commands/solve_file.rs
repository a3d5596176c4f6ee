//! `roadplane solve`: frames with keypoints → poses and camera, no image needed.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use roadplane_base::{CameraEstimate, CameraStatus, CarRecord, FrameRecord, ShapeAtlas};
use roadplane_calibrate::AtRest;
use roadplane_solve::{FreeCarFit, SceneOptions, ShapePrior, fit_free_car};
use roadplane_write::{FrameReader, PoseLines, read_scene_curves, write_camera};

use crate::cameras::estimate::{estimate_cameras, prior_camera};
use crate::cameras::frame::{estimate_frame, estimate_frame_as_paper};
use crate::cameras::known::contradiction;
use crate::tracks::believe::usable;
use crate::tracks::cars::{FrameCamera, HeldPoses, any_car, fit_frame, free_pose_record, pose_record};
use crate::{CameraConstraints, Cancel, Config, PipelineError, Progress};

/// How frames are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SolveMethod {
    /// One camera for all frames; cars stand on its plane.
    #[default]
    Joint,
    /// The same, each frame by itself.
    PerFrame,
    /// Cars are free in six degrees of freedom, drawn to a common plane, by the paper's Algorithm 1; each frame by itself.
    Paper,
    /// Cars are free in six degrees of freedom, before a focal length that is given, or the prior's; the world frame is the prior's, as
    /// `camera.json` says.
    Free,
}

/// What is asked of the solver.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolveOptions {
    /// What is known of the camera.
    pub known: CameraConstraints,
    /// How.
    pub method: SolveMethod,
}

/// Solves a frames file into a poses file, with `camera.json` beside it. Says in the log where the camera could
/// not be estimated; its numbers are then the prior's, with the prior's sds.
///
/// # Errors
/// [`PipelineError`]; neither file then appears.
pub fn solve_file(
    frames: &Path,
    out: &Path,
    options: &SolveOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let atlas = ShapeAtlas::shipped()?;
    let count = lines(frames)?;
    let read = |phase: &str| -> Result<_, PipelineError> {
        progress.phase(phase);
        progress.expect(Some(count));
        Ok(AtRest::new(FrameReader::open(frames)?.map(|record| {
            progress.frame_done();
            record.map_err(PipelineError::from)
        })))
    };
    let known = &options.known;
    let scene = config.solve.scene_options(None);
    let mut poses = Poses {
        lines: PoseLines::create(out)?,
        looks: HeldPoses::default(),
        atlas: &atlas,
        config,
        scene,
        cancel,
    };
    let mut estimates = Vec::new();
    match options.method {
        SolveMethod::Joint => {
            let cameras =
                estimate_cameras(read("camera")?, &read_scene_curves(frames)?, &atlas, known, None, config)?;
            for frame in read("poses")? {
                let frame = frame?;
                if let Some(estimate) = cameras.at(frame.time_s) {
                    poses.standing(&frame, estimate, any_car(&atlas, cameras.size_of_cars()))?;
                }
            }
            for warning in cameras.known().iter().filter_map(contradiction) {
                tracing::warn!("{warning}");
            }
            estimates = cameras.estimates().to_vec();
        }
        SolveMethod::PerFrame => {
            for frame in read("camera and poses")? {
                let frame = frame?;
                let known = known.for_pictures(frame.image_size_px)?;
                let estimate = estimate_frame(&frame, &atlas, &known, config);
                poses.standing(&frame, &estimate, ShapePrior::default())?;
                estimates.push(estimate);
            }
        }
        SolveMethod::Paper => {
            for frame in read("camera and poses")? {
                let frame = frame?;
                let known = known.for_pictures(frame.image_size_px)?;
                let (estimate, fits) = estimate_frame_as_paper(&frame, &atlas, &known, config);
                poses.free(&frame, &estimate, &fits)?;
                estimates.push(estimate);
            }
        }
        SolveMethod::Free => {
            // Without the plane one car says next to nothing of the focal length (paper §3.4): it is given, or the prior's.
            for frame in read("poses")? {
                let frame = frame?;
                if estimates.is_empty() {
                    estimates.push(prior_camera(&known.for_pictures(frame.image_size_px)?, &frame, config));
                }
                let camera = FrameCamera::from(&estimates[0]).camera;
                let fit = |car: &CarRecord| {
                    fit_free_car(&atlas, &camera, &usable(car.keypoints.as_deref()?, config), &poses.scene)
                };
                let fits: Vec<_> = frame.cars.iter().map(fit).collect();
                poses.free(&frame, &estimates[0], &fits)?;
                estimates[0].span_s[1] = frame.time_s;
            }
        }
    }
    poses.lines.finish()?;
    if estimates.iter().any(|estimate| estimate.status == CameraStatus::Unobservable) {
        tracing::warn!("the camera could not be estimated everywhere: its numbers are the prior there");
    }
    Ok(write_camera(&out.with_file_name("camera.json"), &estimates)?)
}

/// Lines of `poses.jsonl`.
struct Poses<'a> {
    lines: PoseLines,
    looks: HeldPoses,
    atlas: &'a ShapeAtlas,
    config: &'a Config,
    scene: SceneOptions,
    cancel: &'a Cancel,
}

impl Poses<'_> {
    /// Those of cars on the plane.
    fn standing(
        &mut self,
        frame: &FrameRecord,
        estimate: &CameraEstimate,
        shape: ShapePrior,
    ) -> Result<(), PipelineError> {
        self.go_on()?;
        let view = FrameCamera::from(estimate);
        let fits = fit_frame(frame, &view, self.atlas, &self.scene, self.config, |_| (shape, None));
        for (i, fit) in fits.iter().enumerate() {
            let fitted = fit.as_ref().and_then(|fit| pose_record(frame, i, fit, self.atlas));
            if let Some(pose) = &fitted {
                self.looks.remember(pose);
            }
            if let Some(pose) = fitted.or_else(|| self.looks.line(frame, i)) {
                self.lines.write(&pose)?;
            }
        }
        Ok(())
    }

    /// Those of cars that are free of it; `fits`: one a car.
    fn free(
        &mut self,
        frame: &FrameRecord,
        estimate: &CameraEstimate,
        fits: &[Option<FreeCarFit>],
    ) -> Result<(), PipelineError> {
        self.go_on()?;
        let plane = FrameCamera::from(estimate).plane;
        for (i, fit) in fits.iter().enumerate() {
            let record =
                fit.as_ref().and_then(|fit| free_pose_record(frame, i, fit, &plane, &self.scene, self.atlas));
            if let Some(pose) = record {
                self.lines.write(&pose)?;
            }
        }
        Ok(())
    }

    fn go_on(&self) -> Result<(), PipelineError> {
        self.cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }))
    }
}

/// How many lines a file has.
fn lines(path: &Path) -> Result<u64, PipelineError> {
    let fail = |source| PipelineError::Unreadable { source, path: path.to_path_buf() };
    let mut reader = BufReader::with_capacity(1 << 18, File::open(path).map_err(fail)?);
    let mut count = 0;
    loop {
        let bytes = reader.fill_buf().map_err(fail)?;
        if bytes.is_empty() {
            return Ok(count);
        }
        count += bytes.iter().filter(|byte| **byte == b'\n').count() as u64;
        let used = bytes.len();
        reader.consume(used);
    }
}
