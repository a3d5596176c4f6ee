//! `roadplane solve`: frames with keypoints → poses and camera, no image needed.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use roadplane_base::{CameraEstimate, CameraStatus, FrameRecord, ShapeAtlas};
use roadplane_calibrate::AtRest;
use roadplane_solve::{ShapePrior, fit_free_car};
use roadplane_write::{FrameReader, PoseLines, read_scene_curves, write_camera};

use crate::cameras::estimate::{estimate_cameras, prior_camera};
use crate::cameras::frame::estimate_frame;
use crate::cameras::known::contradiction;
use crate::tracks::believe::usable;
use crate::tracks::cars::{FrameCamera, HeldPoses, any_car, fit_frame, free_pose_record, pose_record};
use crate::{Cancel, Config, Known, PipelineError, Progress};

/// What is asked of the solver.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolveOptions {
    /// What is known of the camera.
    pub known: Known,
    /// Cars stand on one plane; otherwise every car is free in six degrees of freedom and the world frame is the prior's,
    /// as `camera.json` says.
    pub use_plane: bool,
    /// Each frame is solved on its own.
    pub per_frame: bool,
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
    let mut poses = PoseLines::create(out)?;
    let mut looks = HeldPoses::default();
    let scene = config.solve.scene_options(None);
    let mut write_frame =
        |frame: &FrameRecord, estimate: &CameraEstimate, shape: ShapePrior| -> Result<(), PipelineError> {
            if let Some(signal) = cancel.signal() {
                return Err(PipelineError::Stopped { signal });
            }
            let view = FrameCamera::from(estimate);
            if !options.use_plane {
                for (i, car) in frame.cars.iter().enumerate() {
                    let Some(keypoints) = car.keypoints.as_deref() else { continue };
                    let keypoints = usable(keypoints, config);
                    let fit = fit_free_car(&atlas, &view.camera, &keypoints, &scene);
                    let record =
                        fit.and_then(|fit| free_pose_record(frame, i, &fit, &view.plane, &scene, &atlas));
                    if let Some(pose) = record {
                        poses.write(&pose)?;
                    }
                }
                return Ok(());
            }
            let fits = fit_frame(frame, &view, &atlas, &scene, config, |_| (shape, None));
            for (i, fit) in fits.iter().enumerate() {
                if let Some(pose) = fit.as_ref().and_then(|fit| pose_record(frame, i, fit, &atlas)) {
                    looks.remember(&pose);
                    poses.write(&pose)?;
                } else if let Some(pose) = looks.line(frame, i) {
                    poses.write(&pose)?;
                }
            }
            Ok(())
        };
    let mut estimates = Vec::new();
    if !options.use_plane {
        // Without the plane one car says next to nothing of the focal length (paper §3.4): it is given, or the prior's.
        for frame in read("poses")? {
            let frame = frame?;
            if estimates.is_empty() {
                estimates.push(prior_camera(&known.for_pictures(frame.image_size_px)?, &frame, config));
            }
            write_frame(&frame, &estimates[0], ShapePrior::default())?;
            estimates[0].span_s[1] = frame.time_s;
        }
    } else if options.per_frame {
        for frame in read("camera and poses")? {
            let frame = frame?;
            let known = known.for_pictures(frame.image_size_px)?;
            let estimate = estimate_frame(&frame, &atlas, &known, config);
            write_frame(&frame, &estimate, ShapePrior::default())?;
            estimates.push(estimate);
        }
    } else {
        let cameras =
            estimate_cameras(read("camera")?, &read_scene_curves(frames)?, &atlas, known, None, config)?;
        for frame in read("poses")? {
            let frame = frame?;
            if let Some(estimate) = cameras.at(frame.time_s) {
                write_frame(&frame, estimate, any_car(&atlas, cameras.size_of_cars()))?;
            }
        }
        for warning in cameras.known().iter().filter_map(contradiction) {
            tracing::warn!("{warning}");
        }
        estimates = cameras.estimates().to_vec();
    }
    poses.finish()?;
    if estimates.iter().any(|estimate| estimate.status == CameraStatus::Unobservable) {
        tracing::warn!("the camera could not be estimated everywhere: its numbers are the prior there");
    }
    Ok(write_camera(&out.with_file_name("camera.json"), &estimates)?)
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
