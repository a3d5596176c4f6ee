//! Command `roadplane stage solve`: estimates the camera and the poses of cars from a file of frames with keypoints,
//! without images.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use roadplane_base::{CameraEstimate, CameraStatus, CarRecord, FrameRecord, PoseRecord, ShapeAtlas};
use roadplane_measure::{FrameCamera, any_car, fit_frame, usable};
use roadplane_solve::{FreeCarFit, SceneOptions, ShapePrior, fit_free_car};
use roadplane_write::{FrameReader, PoseLines, RunStatus, write_camera};

use crate::cameras::estimate::{CameraInputs, optics_of};
use crate::cameras::frame::{estimate_frame, estimate_frame_as_paper, prior_camera};
use crate::cameras::known::{contradiction, in_first_picture};
use crate::not_followed::FollowCount;
use crate::tracks::poses::{CarriedPoses, free_pose_record, move_to_picture, pose_record};
use crate::{CameraConstraints, Cancel, Config, PipelineError, Progress};

/// Method that estimates the camera and the poses of cars from frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SolveMethod {
    /// All frames share one camera. Cars are on the ground plane of that camera.
    #[default]
    Joint,
    /// Each frame has its own camera. Cars are on the ground plane of that camera.
    PerFrame,
    /// Each frame has its own camera, estimated by Algorithm 1 of the paper. Cars have six degrees of freedom, and a
    /// soft constraint pulls them towards a common plane.
    Paper,
    /// Cars have six degrees of freedom and no ground plane. The focal length is that of the user or, without one, that
    /// of the prior. The prior camera defines the world frame and is written to `camera.json`.
    Free,
}

/// Options of [`solve_file`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolveOptions {
    /// User constraints on the camera.
    pub constraints: CameraConstraints,
    /// Method that estimates the camera and the poses.
    pub method: SolveMethod,
}

/// Estimates the camera and the poses of cars from a file of frames. Writes the poses to `out`, and `camera.json` to
/// the same folder. Returns whether the vehicles of many frames were left out, as the camera's motion is unknown there.
///
/// If a camera cannot be estimated, its values and sds are those of the prior, and a warning is logged.
///
/// # Errors
/// Returns a [`PipelineError`] if estimation cannot be completed. Only if `camera.json` cannot be written, the poses are
/// there alone.
pub fn solve_file(
    frames: &Path,
    out: &Path,
    options: &SolveOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<bool, PipelineError> {
    let atlas = ShapeAtlas::shipped()?;
    let count = lines(frames)?;
    let optics = optics_of(frames, &options.constraints, None, &atlas, config)?;
    let read = |phase: &str| -> Result<_, PipelineError> {
        progress.phase(phase);
        progress.expect(Some(count));
        let records = FrameReader::open(frames)?.map(|record| {
            progress.frame_done();
            record.map_err(PipelineError::from)
        });
        Ok(optics.convert(records))
    };
    let (constraints, _, warning) = in_first_picture(&options.constraints, None, || read("frames"))?;
    warning.iter().for_each(|warning| tracing::warn!("{warning}"));
    let mut followed = FollowCount::default();
    for frame in read("frames")? {
        followed.add(&frame?);
    }
    let not_followed = followed.finish();
    not_followed.in_words().iter().for_each(|warning| tracing::warn!("{warning}"));
    let scene = config.solve.scene_options(None);
    let mut poses = Poses {
        lines: PoseLines::create(out)?,
        carried: CarriedPoses::default(),
        atlas: &atlas,
        config,
        scene,
        cancel,
    };
    let mut estimates = Vec::new();
    match options.method {
        SolveMethod::Joint => {
            let (optics, atlas, known) = (&optics, &atlas, &constraints);
            let inputs =
                CameraInputs { optics, atlas, known, history: None, scene: None, may_fold: true, config };
            let cameras = inputs.estimate(|| read("camera"))?;
            for frame in read("poses")? {
                let frame = frame?;
                if let Some(estimate) = cameras.at(frame.time_s) {
                    poses.on_plane(
                        &frame,
                        &FrameCamera::from(estimate),
                        any_car(atlas, cameras.size_of_cars),
                    )?;
                }
            }
            for warning in cameras.constraints.iter().filter_map(contradiction) {
                tracing::warn!("{warning}");
            }
            estimates = cameras.estimates;
        }
        SolveMethod::PerFrame => {
            for frame in read("camera and poses")? {
                let frame = frame?;
                let constraints = constraints.for_pictures(frame.image_size_px)?;
                let estimate = estimate_frame(&frame, &atlas, &constraints, config);
                poses.on_plane(&frame, &FrameCamera::from(&estimate), ShapePrior::default())?;
                estimates.push(estimate);
            }
        }
        SolveMethod::Paper => {
            if !constraints.is_silent() {
                tracing::warn!(
                    "the paper's method uses only an exact focal length and a lens: other constraints are left out"
                );
            }
            for frame in read("camera and poses")? {
                let frame = frame?;
                let constraints = constraints.for_pictures(frame.image_size_px)?;
                let (estimate, fits) = estimate_frame_as_paper(&frame, &atlas, &constraints, config);
                poses.free(&frame, &estimate, &fits)?;
                estimates.push(estimate);
            }
        }
        SolveMethod::Free => {
            // Without the plane, one car hardly constrains the focal length (paper §3.4). So the focal length comes
            // from the user or the prior.
            for frame in read("poses")? {
                let frame = frame?;
                if estimates.is_empty() {
                    let constraints = constraints.for_pictures(frame.image_size_px)?;
                    estimates.push(prior_camera(&frame, &constraints, config));
                }
                let camera = FrameCamera::from(&estimates[0]).camera;
                let fit = |car: &CarRecord| {
                    fit_free_car(
                        &atlas,
                        &camera,
                        &usable(car.keypoints.as_deref()?, config.solve.min_keypoint_score),
                        &poses.scene,
                    )
                };
                let fits: Vec<_> = frame.cars.iter().map(fit).collect();
                poses.free(&frame, &estimates[0], &fits)?;
                estimates[0].span_s[1] = frame.time_s;
            }
        }
    }
    poses.lines.finish()?;
    if estimates.iter().any(|estimate| estimate.status == CameraStatus::Unobservable) {
        tracing::warn!("at least one camera could not be estimated: its values are those of the prior");
    }
    write_camera(&out.with_file_name("camera.json"), &estimates, Vec::new())?;
    Ok(not_followed.status(false) != RunStatus::Complete)
}

/// Fits the cars of frames and writes their poses to a file.
struct Poses<'a> {
    lines: PoseLines,
    carried: CarriedPoses,
    atlas: &'a ShapeAtlas,
    config: &'a Config,
    scene: SceneOptions,
    cancel: &'a Cancel,
}

impl Poses<'_> {
    /// Fits the cars of a frame on the ground plane and writes their poses.
    fn on_plane(
        &mut self,
        frame: &FrameRecord,
        view: &FrameCamera,
        shape: ShapePrior,
    ) -> Result<(), PipelineError> {
        self.check_stop()?;
        let fits =
            fit_frame(frame, view, self.atlas, &self.scene, self.config.solve.min_keypoint_score, |_| {
                (shape, None)
            });
        for (i, fit) in fits.iter().enumerate() {
            let fitted = fit.as_ref().and_then(|fit| pose_record(frame, i, fit, view, self.atlas));
            if let Some(pose) = &fitted {
                self.carried.store(pose);
            }
            if let Some(pose) = fitted.or_else(|| self.carried.line(frame, i)) {
                self.write(pose, frame)?;
            }
        }
        Ok(())
    }

    /// Writes the poses of a frame's cars with six degrees of freedom. `fits` has one entry for each car of the frame.
    fn free(
        &mut self,
        frame: &FrameRecord,
        estimate: &CameraEstimate,
        fits: &[Option<FreeCarFit>],
    ) -> Result<(), PipelineError> {
        self.check_stop()?;
        let plane = estimate.params.plane();
        for (i, fit) in fits.iter().enumerate() {
            let record =
                fit.as_ref().and_then(|fit| free_pose_record(frame, i, fit, &plane, &self.scene, self.atlas));
            if let Some(pose) = record {
                self.write(pose, frame)?;
            }
        }
        Ok(())
    }

    /// Writes a pose with the pixels of its own frame.
    fn write(&mut self, mut pose: PoseRecord, frame: &FrameRecord) -> Result<(), PipelineError> {
        if let Some(picture_from_world) = frame.watch.as_ref().and_then(|watch| watch.picture_from_world) {
            move_to_picture(&mut pose, &picture_from_world);
        }
        Ok(self.lines.write(&pose)?)
    }

    fn check_stop(&self) -> Result<(), PipelineError> {
        self.cancel.signal().map_or(Ok(()), |signal| Err(PipelineError::Stopped { signal }))
    }
}

/// Counts the lines of a file.
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
