//! The keypoints that all systems get as input.

use std::path::Path;

use nalgebra::Vector2;
use roadplane_base::{CarRecord, FrameRecord, ImageSize, KEYPOINTS, Keypoint, KeypointSet, assign, bbox_iou};
use roadplane_keypoints::KeypointNet;
use roadplane_pipeline::{Config, PipelineError, open_input};
use roadplane_synth::Rng;
use roadplane_write::FrameReader;

use crate::LabError;
use roadplane_metrics::scoring::counts;
use roadplane_metrics::truth::{TrueCar, TrueFrame, Truth};

/// Scores of simulated keypoints: hidden and visible. The values are close to the scores of the net.
const SCORES: [f64; 2] = [0.1, 0.95];
/// Smallest sd of a keypoint, as a share of the longer side of the car's box.
const MIN_SD_SHARE: f64 = 0.002;
/// Least overlap (IoU) at which a measured box is matched with a true box.
const MIN_IOU: f64 = 0.5;

/// Keypoints of the processed frames of an item.
#[derive(Clone, Debug, Default)]
pub(super) struct SceneEvidence {
    pub frames: Vec<FrameEvidence>,
}

/// Keypoints of the scored cars of a frame. Cars that are too small or too hidden are not scored.
#[derive(Clone, Debug)]
pub(super) struct FrameEvidence {
    /// Index of the frame in the truth.
    pub index: usize,
    /// Indices of the scored cars among the cars of the true frame.
    pub cars: Vec<usize>,
    /// Keypoints found for each car; all `None` if nothing was found.
    pub keypoints: Vec<KeypointSet>,
}

impl SceneEvidence {
    /// Returns the indices of at most `most` frames, evenly spread.
    pub fn sample(&self, most: usize) -> Vec<usize> {
        let step = self.frames.len().div_ceil(most.max(1)).max(1);
        (0..self.frames.len()).step_by(step).collect()
    }
}

impl FrameEvidence {
    /// Returns the keypoints, with `None` for keypoints whose score is below `solve.min_keypoint_score`.
    pub fn usable(&self, config: &Config) -> Vec<KeypointSet> {
        let sure = |point: &Keypoint| point.score >= config.solve.min_keypoint_score;
        self.keypoints.iter().map(|set| set.map(|point| point.filter(sure))).collect()
    }

    /// Returns the frame as a record of the file `frames.jsonl`.
    pub fn record(&self, truth: &Truth) -> FrameRecord {
        let frame = &truth.frames[self.index];
        let cars = self.cars.iter().zip(&self.keypoints);
        let car = |(car, set): (&usize, &KeypointSet)| CarRecord {
            keypoints: Some(Box::new(*set)),
            ..CarRecord::boxed(frame.cars[*car].bbox_px)
        };
        FrameRecord {
            cars: cars.map(car).collect(),
            ..FrameRecord::empty(frame.frame, frame.time_s, truth.camera.image_size_px)
        }
    }
}

fn counted(truth: &Truth, frame: &TrueFrame) -> Vec<usize> {
    let counts = |car: &TrueCar| truth.model(car.id).is_some_and(|model| counts(car, model));
    (0..frame.cars.len()).filter(|c| counts(&frame.cars[*c])).collect()
}

/// Predicts keypoints with the net, in the true boxes around the visible parts of the cars.
///
/// For an item without picture or video, reads the measured keypoints from `NAME.frames.jsonl` beside the truth file.
pub(super) fn from_net(
    truth: &Truth,
    path: &Path,
    net: &mut KeypointNet,
    config: &Config,
) -> Result<SceneEvidence, LabError> {
    let Some(media) = &truth.media else { return from_file(truth, path, config.decode.stride) };
    let mut input = open_input(media, config)?;
    if input.size() != truth.camera.image_size_px {
        let [w, h] = <[u32; 2]>::from(input.size());
        return Err(LabError::malformed(path, format!("camera.image_size_px: the media has {w} × {h} px")));
    }
    let mut scene = SceneEvidence::default();
    while let Some(frame) = input.next_frame().map_err(PipelineError::from)? {
        let index = truth.frames.binary_search_by_key(&frame.stamp.index, |f| f.frame);
        let Ok(index) = index else { continue };
        let cars = counted(truth, &truth.frames[index]);
        let mut records: Vec<CarRecord> =
            cars.iter().map(|c| CarRecord::boxed(truth.frames[index].cars[*c].bbox_px)).collect();
        net.locate(&frame, &mut records).map_err(PipelineError::from)?;
        let keypoints =
            records.into_iter().map(|r| r.keypoints.map_or([None; KEYPOINTS], |set| *set)).collect();
        scene.frames.push(FrameEvidence { index, cars, keypoints });
    }
    Ok(scene)
}

fn from_file(truth: &Truth, path: &Path, stride: u32) -> Result<SceneEvidence, LabError> {
    let name = roadplane_metrics::truth::scene_name(path);
    let mut scene = SceneEvidence::default();
    for measured in FrameReader::open(&path.with_file_name(format!("{name}.frames.jsonl")))? {
        let measured = measured?;
        if !measured.frame.is_multiple_of(u64::from(stride.max(1))) {
            continue;
        }
        let Ok(index) = truth.frames.binary_search_by_key(&measured.frame, |f| f.frame) else { continue };
        let frame = &truth.frames[index];
        let cars = counted(truth, frame);
        let cost = |i: usize, j: usize| {
            1.0 - bbox_iou(&frame.cars[cars[i]].whole_bbox_px, &measured.cars[j].bbox_px)
        };
        let chosen = assign(cars.len(), measured.cars.len(), 1.0 - MIN_IOU, cost);
        let set = |j: Option<usize>| j.and_then(|j| measured.cars[j].keypoints.as_deref().copied());
        let keypoints = chosen.into_iter().map(|j| set(j).unwrap_or([None; KEYPOINTS])).collect();
        scene.frames.push(FrameEvidence { index, cars, keypoints });
    }
    Ok(scene)
}

/// Returns the true keypoints with Gaussian noise. `noise` is the sd as a share of the longer side of a car's visible
/// box.
///
/// Keypoints outside the picture are left out, because no net could find them.
pub(super) fn from_truth(truth: &Truth, noise: f64, seed: u64, stride: u32) -> SceneEvidence {
    let mut rng = Rng::new(seed);
    let size = truth.camera.image_size_px;
    let mut scene = SceneEvidence::default();
    for (index, frame) in truth.frames.iter().enumerate() {
        if !frame.frame.is_multiple_of(u64::from(stride.max(1))) {
            continue;
        }
        let cars = counted(truth, frame);
        let keypoints =
            cars.iter().map(|c| noisy_keypoints(&frame.cars[*c], noise, size, &mut rng)).collect();
        scene.frames.push(FrameEvidence { index, cars, keypoints });
    }
    scene
}

/// Returns a car's true keypoints with Gaussian noise. `noise` is the sd as a share of the longer side of the car's
/// box.
pub(crate) fn noisy_keypoints(car: &TrueCar, noise: f64, size: ImageSize, rng: &mut Rng) -> KeypointSet {
    let [x0, y0, x1, y1] = car.bbox_px;
    let side_px = (x1 - x0).max(y1 - y0);
    let sd_px = noise.max(MIN_SD_SHARE) * side_px;
    std::array::from_fn(|i| {
        let [x, y, visible] = car.keypoints_px.get(i).copied().flatten()?;
        let inside = (0.0..f64::from(size.width)).contains(&x) && (0.0..f64::from(size.height)).contains(&y);
        let off = Vector2::new(rng.normal(), rng.normal()) * (noise * side_px);
        let score = SCORES[usize::from(visible > 0.5)];
        inside.then(|| Keypoint::isotropic(Vector2::new(x, y) + off, score, sd_px))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_metrics::truth::fixture::lot;

    #[test]
    fn noise_has_the_given_sd_and_is_the_same_each_time() {
        let mut truth = lot(40);
        truth.frames[0].cars[0].keypoints_px[3] = None;
        if let Some(point) = &mut truth.frames[0].cars[0].keypoints_px[4] {
            point[2] = 0.0;
        }
        let scene = from_truth(&truth, 0.02, 7, 2);
        assert_eq!(scene.frames.len(), 20);
        let (mut square, mut count) = (0.0, 0.0);
        for frame in &scene.frames {
            for (c, set) in frame.cars.iter().zip(&frame.keypoints) {
                let car = &truth.frames[frame.index].cars[*c];
                let side = roadplane_base::bbox_longer_side(&car.bbox_px);
                for (point, truth) in set.iter().zip(&car.keypoints_px) {
                    let (Some(point), Some([x, y, _])) = (point, truth) else { continue };
                    square += (point.pixel - Vector2::new(*x, *y)).norm_squared() / (0.02 * side).powi(2);
                    count += 2.0;
                }
            }
        }
        assert!((square / count - 1.0_f64).abs() < 0.06, "{}", square / count);
        let first = &scene.frames[0].keypoints[0];
        assert!(first[3].is_none());
        assert!(first[4].is_some_and(|p| p.score < 0.3) && first[5].is_some_and(|p| p.score > 0.9));
        assert!(scene.frames[0].usable(&Config::default())[0][4].is_none());
        assert_eq!(from_truth(&truth, 0.02, 7, 2).frames[3].keypoints, scene.frames[3].keypoints);
        assert_eq!(scene.sample(10), (0..20).step_by(2).collect::<Vec<_>>());
        assert_eq!(scene.frames[1].record(&truth).frame, 2);
    }
}
