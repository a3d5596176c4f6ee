//! Single pictures with a reference camera and keypoints from our nets, for the tables on the steps of the solver.

use std::path::Path;

use roadplane_base::CarRecord;
use roadplane_detect::Detector;
use roadplane_keypoints::KeypointNet;
use roadplane_pipeline::{Cancel, Config, PipelineError, open_detector, open_keypoints};

use super::evidence;
use super::items::{FRAMES_OF_CLIP, item};
use crate::LabError;
use crate::evaluate::solver::ReferencePicture;
use crate::parallel::try_in_parallel;
use crate::work::{read_picture, stopped};
use roadplane_metrics::readers::cameras::{ReferenceCamera, read_cameras};
use roadplane_metrics::truth::read_dataset;

/// Returns the stills and a few frames of each clip of a data set, with keypoints that our net predicts in the true
/// boxes.
///
/// # Errors
/// [`LabError`] if a file cannot be read, a net fails, or the user stops the work.
pub fn dataset_pictures(
    folder: &Path,
    models: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<Vec<ReferencePicture>, LabError> {
    let dataset = read_dataset(folder)?;
    let open = || open_keypoints(models, config).map_err(LabError::from);
    let found = |net: &mut KeypointNet, i: usize| {
        stopped(cancel)?;
        let item = item(&dataset.items[i])?;
        let scene = evidence::from_net(&item.truth, &item.path, net, config)?;
        let camera = &item.truth.camera;
        let picture = |index: usize| {
            let frame = &scene.frames[index];
            let truth = &item.truth.frames[frame.index];
            let heading = |car: &usize| {
                let rows = &truth.cars[*car].world_from_car;
                Some(rows[1][0].atan2(rows[0][0]))
            };
            ReferencePicture {
                size: camera.image_size_px,
                cars: frame.usable(config),
                focal_px: camera.focal_px,
                plane: camera.plane(),
                sd: [0.0; 4],
                headings: frame.cars.iter().map(heading).collect(),
            }
        };
        Ok(scene.sample(FRAMES_OF_CLIP).into_iter().map(picture).collect::<Vec<_>>())
    };
    let pictures: Vec<Vec<ReferencePicture>> = try_in_parallel(dataset.items.len(), open, found)?;
    Ok(pictures.into_iter().flatten().collect())
}

/// Returns one picture of each real camera in the file `cameras.json`, with the cars that our nets find.
///
/// Cameras with strong lens distortion are left out. The picture of a clip is its first frame.
///
/// # Errors
/// [`LabError`] if a file cannot be read, a net fails, or the user stops the work.
pub fn camera_pictures(
    cameras: &Path,
    models: &Path,
    config: &Config,
    cancel: &Cancel,
) -> Result<Vec<ReferencePicture>, LabError> {
    let cameras: Vec<ReferenceCamera> =
        read_cameras(cameras)?.into_iter().filter(ReferenceCamera::is_straight).collect();
    let open = || Ok::<_, LabError>((open_detector(models, config)?, open_keypoints(models, config)?));
    let found = |(detector, net): &mut (Detector, KeypointNet), i: usize| {
        stopped(cancel)?;
        let camera = &cameras[i];
        let frame = read_picture(&camera.media, config)?;
        let mut cars = detector.detect(&frame).map_err(PipelineError::from)?;
        net.locate(&frame, &mut cars).map_err(PipelineError::from)?;
        let least = config.solve.min_keypoint_score;
        let sure = |car: CarRecord| {
            let set = car.keypoints?;
            Some(set.map(|point| point.filter(|point| point.score >= least)))
        };
        let cars: Vec<_> = cars.into_iter().filter_map(sure).collect();
        Ok(ReferencePicture {
            size: camera.size,
            headings: vec![None; cars.len()],
            cars,
            focal_px: camera.focal_px,
            plane: camera.plane,
            sd: camera.sd,
        })
    };
    try_in_parallel(cameras.len(), open, found)
}
