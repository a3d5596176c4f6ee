//! Table 3 of the paper *Car Pose in Context*: ADD on the user's own copy of the KITTI object benchmark.
//!
//! All systems get the keypoints that our net predicts in the true boxes.

use std::path::{Path, PathBuf};

use nalgebra::Vector2;
use roadplane_base::{CarRecord, GroundPlane, ImageSize, KEYPOINTS, Keypoint, KeypointSet, ShapeAtlas};
use roadplane_keypoints::KeypointNet;
use roadplane_pipeline::{Cancel, Config, PipelineError, Progress, open_input, open_keypoints};
use roadplane_tables::{Cell, Column, Report, Table, bootstrap, median, quantile};

use crate::LabError;
use crate::parallel::in_parallel;
use crate::systems::{FrameInput, System};
use crate::tables::{add_plot, add_table, viewpoint_plot, viewpoint_table};
use crate::work::stopped;
use roadplane_metrics::readers::kitti::{KittiCamera, KittiItem, KittiObject, object_items};
use roadplane_metrics::scoring::{PoseScore, score_box};

/// The systems that do not need the true ground, which KITTI does not label.
const SYSTEMS: [System; 5] =
    [System::Pavlakos, System::KrishnaMurthy, System::FreePoses, System::Plane, System::PlaneFocal];
/// Height of KITTI's cameras above a level street, m (Geiger et al. 2013, Fig. 1).
const CAMERA_HEIGHT_M: f64 = 1.65;
/// Least number of vehicles in an image that is used. The paper uses images with more than three vehicles.
const MIN_VEHICLES: usize = 4;
/// Largest share of a car outside the picture at which the car is still scored.
const MAX_TRUNCATED: f64 = 0.5;
/// Highest KITTI occlusion level of a scored car (level 3 means unknown).
const MAX_OCCLUDED: i32 = 2;
/// Minimum length of the longer side of a scored car's box, px.
const MIN_SIDE_PX: f64 = 24.0;

/// Options of the evaluation on KITTI.
#[derive(Clone, Debug)]
pub struct KittiOptions {
    /// Share of the images to evaluate; 0.1 means every tenth image.
    pub part: f64,
    /// Folder of the nets' files.
    pub models: PathBuf,
}

/// An image with the keypoints that the net found in it.
struct Picture {
    item: KittiItem,
    size: ImageSize,
    /// The cars that are scored.
    cars: Vec<KittiObject>,
    keypoints: Vec<KeypointSet>,
}

/// The scores of a system's answer for an image.
struct Solved {
    poses: Vec<PoseScore>,
    /// Relative error of the focal length; `None` if the system does not estimate the focal length.
    focal: Option<f64>,
}

/// Evaluates five systems on the folder of the KITTI object benchmark (`training/` with `image_2`, `label_2`, `calib`).
///
/// # Errors
/// [`LabError`] if a file is missing or malformed, a net fails, or the user stops the work.
pub fn evaluate_kitti(
    folder: &Path,
    options: &KittiOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let atlas = ShapeAtlas::shipped().map_err(PipelineError::from)?;
    let all = object_items(folder, MIN_VEHICLES)?;
    let step = (1.0 / options.part.clamp(1e-6, 1.0)).round() as usize;
    let (images, items) = (all.len(), all.into_iter().step_by(step));
    let mut net = open_keypoints(&options.models, config)?;
    progress.phase("keypoints");
    progress.expect(Some(items.len() as u64));
    let mut pictures = Vec::new();
    for item in items {
        stopped(cancel)?;
        pictures.push(picture(item, &mut net, config)?);
        progress.frame_done();
    }
    progress.phase("solving");
    let solved = in_parallel(pictures.len(), |i| {
        SYSTEMS.map(|system| (!cancel.is_stopped()).then(|| solve(system, &pictures[i], &atlas, config)))
    });
    stopped(cancel)?;
    let of_system = |k: usize| solved.iter().filter_map(move |systems| systems[k].as_ref());
    let poses: Vec<Vec<Vec<PoseScore>>> =
        (0..SYSTEMS.len()).map(|k| of_system(k).map(|image| image.poses.clone()).collect()).collect();
    let rows: Vec<(&str, &[Vec<PoseScore>])> =
        SYSTEMS.iter().zip(&poses).map(|(system, poses)| (system.name(), poses.as_slice())).collect();
    let mut add = add_table("Table 3, ADD: KITTI", &rows);
    add.note = format!(
        "{} of {images} images with more than three vehicles; Car and Van, at most half out of the picture, occlusion known. \
         Points: the eight corners of the 3D box. {} Systems 1–4 get the true focal length.",
        pictures.len(),
        add.note
    );
    let focal: Vec<Vec<f64>> = SYSTEMS
        .iter()
        .position(|system| *system == System::PlaneFocal)
        .map(|k| of_system(k).map(|image| image.focal.into_iter().collect()).collect())
        .unwrap_or_default();
    let tables = vec![add, viewpoint_table("Viewpoint: KITTI", &rows), focal_table(&focal)];
    let plots = vec![add_plot(&rows), viewpoint_plot(&rows)];
    Ok(Report { title: "KITTI objects".to_owned(), tables, plots, ..Report::default() })
}

fn counts(object: &KittiObject) -> bool {
    let [x0, y0, x1, y1] = object.bbox_px;
    object.is_car()
        && object.truncated <= MAX_TRUNCATED
        && (0..=MAX_OCCLUDED).contains(&object.occluded)
        && (x1 - x0).max(y1 - y0) >= MIN_SIDE_PX
}

/// Predicts keypoints with the net, in the true boxes of the scored cars of an image.
fn picture(item: KittiItem, net: &mut KeypointNet, config: &Config) -> Result<Picture, LabError> {
    let mut input = open_input(&item.image, config)?;
    let size = input.size();
    let frame = input.next_frame().map_err(PipelineError::from)?;
    let frame = frame.ok_or_else(|| LabError::malformed(&item.image, "holds no picture"))?;
    let cars: Vec<KittiObject> = item.objects.iter().filter(|object| counts(object)).cloned().collect();
    let record = |car: &KittiObject| CarRecord::boxed(car.bbox_px);
    let mut records: Vec<CarRecord> = cars.iter().map(record).collect();
    net.locate(&frame, &mut records).map_err(PipelineError::from)?;
    let keypoints = records.into_iter().map(|record| {
        let found = record.keypoints.map_or([None; KEYPOINTS], |set| *set);
        usable(&found, &item.camera, size, config)
    });
    Ok(Picture { size, cars, keypoints: keypoints.collect(), item })
}

/// Returns the keypoints with a sufficient score, shifted in the picture.
///
/// The systems take the picture's middle as the principal point, so the shift is from the true principal point to the
/// middle.
fn usable(found: &KeypointSet, camera: &KittiCamera, size: ImageSize, config: &Config) -> KeypointSet {
    let shift: Vector2<f64> = size.centre_px() - camera.camera.principal_point_px;
    found.map(|point| {
        let sure = point.filter(|point| point.score >= config.solve.min_keypoint_score)?;
        Some(Keypoint { pixel: sure.pixel + shift, ..sure })
    })
}

fn solve(system: System, picture: &Picture, atlas: &ShapeAtlas, config: &Config) -> Solved {
    let true_focal_px = picture.item.camera.camera.focal_px;
    let plane = GroundPlane::from_tilt_roll_height(0.0, 0.0, CAMERA_HEIGHT_M);
    let input = FrameInput { size: picture.size, focal_px: true_focal_px, plane, cars: &picture.keypoints };
    let answer = system.solve(atlas, &input, config);
    let poses = picture.cars.iter().zip(&answer.cars).map(|(car, answer)| {
        let truth = car.camera_from_box(&picture.item.camera);
        answer.map_or(PoseScore::missed(&truth), |answer| {
            score_box(car.dims_m, &truth, &answer.camera_from_car, &answer.shape, atlas)
        })
    });
    let error = |focal_px: f64| (focal_px / true_focal_px - 1.0).abs();
    let focal = (system == System::PlaneFocal)
        .then(|| answer.camera.map_or(f64::INFINITY, |camera| error(camera.focal_px)));
    Solved { poses: poses.collect(), focal }
}

fn focal_table(images: &[Vec<f64>]) -> Table {
    let columns = vec![
        Column::new("system", 0),
        Column::new("images", 0),
        Column::new("focal, median %", 1),
        Column::new("focal, 90 % within %", 1),
    ];
    let mut table = Table::new("Focal length: KITTI", "From single images.", columns);
    table.rows.push(vec![
        Cell::from(System::PlaneFocal.name()),
        images.len().to_string().into(),
        bootstrap(images, median).scaled(100.0).into(),
        bootstrap(images, |v| quantile(v, 0.9)).scaled(100.0).into(),
    ]);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::of_simulated_keypoints;
    use nalgebra::{Point3, Translation3, Vector3};
    use roadplane_base::Shape;

    /// Returns five cars of the mean shape in front of a level camera. Its principal point is not in the picture's
    /// middle.
    fn street(atlas: &ShapeAtlas) -> Picture {
        let camera = KittiCamera::new(720.0, [600.0, 170.0], Vector3::new(0.06, 0.0, 0.003));
        let size = ImageSize { width: 1242, height: 375 };
        let object = |x: f64, z: f64, rotation_y: f64| KittiObject {
            kind: "Car".to_owned(),
            truncated: 0.0,
            occluded: 0,
            bbox_px: [0.0, 0.0, 100.0, 60.0],
            dims_m: atlas.dims_m(&Shape::zeros()).into(),
            location_m: [x, 1.65, z],
            rotation_y,
        };
        let cars = vec![
            object(-4.0, 12.0, -1.5),
            object(4.0, 14.0, 1.6),
            object(-3.5, 20.0, -1.2),
            object(3.5, 26.0, 1.5),
            object(1.0, 35.0, 0.3),
        ];
        let ahead = roadplane_metrics::scoring::body_centre_m(atlas, &Shape::zeros());
        let keypoints = |car: &KittiObject| {
            let camera_from_car = car.camera_from_box(&camera) * Translation3::new(-ahead, 0.0, 0.0);
            let found = atlas.mean.map(|p| {
                let pixel = camera.camera.pixel_from_camera(&(camera_from_car * Point3::from(p)).coords)?;
                Some(Keypoint::isotropic(pixel, 0.9, 0.5))
            });
            usable(&found, &camera, size, &Config::default())
        };
        let keypoints = cars.iter().map(keypoints).collect();
        let item = KittiItem {
            name: "street".to_owned(),
            image: "street.png".into(),
            camera,
            objects: cars.clone(),
        };
        Picture { item, size, cars, keypoints }
    }

    #[test]
    fn exact_keypoints_give_the_labelled_boxes() {
        // The mean shape belongs to no body type, so the atlas gets none here.
        let atlas = ShapeAtlas { body_types: Vec::new(), ..ShapeAtlas::shipped().unwrap() };
        let picture = street(&atlas);
        for system in SYSTEMS {
            let solved = solve(system, &picture, &atlas, &of_simulated_keypoints(&Config::default()));
            let worst = solved.poses.iter().map(|pose| pose.add).fold(0.0, f64::max);
            let turned = solved.poses.iter().map(|pose| pose.rotation_rad).fold(0.0, f64::max);
            // The keypoints are exact, but their sds are not 0. A solver with more freedom than six modes is therefore
            // off by a little: 0.09 d if the focal length is estimated, otherwise below 0.07 d (d: car diameter).
            assert!(worst < 0.1 && turned < 0.01, "{}: {worst} d, {turned} rad", system.name());
            assert!(solved.focal.is_none_or(|error| error < 0.02), "{:?}", solved.focal);
        }
    }
}
