//! The video row of the table of activities: a small net whose input is the pixels around a vehicle over time
//! (`scripts/train/activity/video.py`).

use std::collections::BTreeMap;
use std::path::Path;

use ndarray::{ArrayView2, ArrayView5};
use roadplane_activity::{LABELS, Labelled, Probabilities, STEP_S, grid};
use roadplane_decode::{DecodeOptions, open};
use roadplane_infer::{Dim, InferError, NamedTensor, ProviderChoice, Session, SessionOptions};
use roadplane_pipeline::PipelineError;

use super::windows::{BEFORE, CROP_BYTES, PREDICTED, PREDICTED_BEFORE, SIDE_PX, STEPS, Square};
use crate::LabError;

/// The net that labels activities from the pixels of a video. Its scores are the row `video` of the tables.
pub(super) struct VideoNet {
    session: Session,
}

/// The boxes of a track: pairs of time (s, ascending) and box (left, top, right, bottom, px).
pub(super) type Boxes = Vec<(f64, [f64; 4])>;

/// A window of a track: the pixels in a square around the vehicle, over [`STEPS`] time steps.
struct Window {
    track: u64,
    step: i64,
    square: Square,
    /// The [`STEPS`] crops as RGB bytes. A crop is empty until it is cut out of the video.
    crops: Vec<Vec<u8>>,
}

/// The predicted probabilities of a track's labels, by time step.
type Predictions = BTreeMap<i64, [f64; LABELS]>;

impl VideoNet {
    /// Loads the net that the file `card` describes.
    ///
    /// # Errors
    /// [`LabError::Pipeline`] if the net cannot be loaded; [`MetricsError::Malformed`](roadplane_metrics::MetricsError)
    /// if the net's inputs or outputs do not have the expected shapes.
    pub fn open(card: &Path) -> Result<Self, LabError> {
        let options = SessionOptions { provider: ProviderChoice::Cpu, threads: 1, library: None };
        let session = Session::open(card, &options).map_err(PipelineError::from)?;
        let (inputs, outputs) = (session.card().input("crops"), session.card().output("labels"));
        let fixed = |shape: &[Dim], sizes: &[usize]| {
            shape.len() == sizes.len() + 1
                && shape[1..].iter().zip(sizes).all(|(dim, size)| *dim == Dim::Fixed(*size))
        };
        if !inputs.is_some_and(|spec| fixed(&spec.shape, &[STEPS, SIDE_PX, SIDE_PX, 3]))
            || !outputs.is_some_and(|spec| fixed(&spec.shape, &[PREDICTED, LABELS]))
        {
            let what = format!(
                "the net must take crops [.., {STEPS}, {SIDE_PX}, {SIDE_PX}, 3] and return labels \
                [.., {PREDICTED}, {LABELS}]"
            );
            return Err(LabError::malformed(card, what));
        }
        Ok(Self { session })
    }

    /// Predicts the activity labels of a video's tracks. Returns the labels by id of the track.
    ///
    /// # Errors
    /// [`LabError::Pipeline`] if the video cannot be read or the inference runtime fails.
    pub fn predict(
        &mut self,
        media: &Path,
        tracks: &BTreeMap<u64, Boxes>,
    ) -> Result<BTreeMap<u64, Labelled>, LabError> {
        let mut windows: Vec<Window> =
            tracks.iter().flat_map(|(track, boxes)| windows_of(*track, boxes)).collect();
        cut_all(media, &mut windows)?;
        let mut predicted: BTreeMap<u64, Predictions> = BTreeMap::new();
        for window in &windows {
            let probabilities = self.of_window(window)?;
            let steps = (window.step - PREDICTED_BEFORE..).zip(probabilities);
            predicted.entry(window.track).or_default().extend(steps);
        }
        let labelled = |(track, predicted): (u64, Predictions)| {
            let time_s: Vec<f64> = tracks.get(&track)?.iter().map(|(time_s, _)| *time_s).collect();
            let within = grid(*time_s.first()?, *time_s.last()?);
            let (steps, p): (Vec<i64>, Vec<[f64; LABELS]>) =
                predicted.into_iter().filter(|(step, _)| within.contains(step)).unzip();
            let nothing = vec![0.0; steps.len()];
            let found = Probabilities { steps, p, gap_s: nothing.clone(), speed_mps: nothing };
            Some((track, found.steady(&time_s)))
        };
        Ok(predicted.into_iter().filter_map(labelled).collect())
    }

    /// Runs the net on a window. Returns the probabilities of all labels at each predicted time step.
    fn of_window(&mut self, window: &Window) -> Result<[[f64; LABELS]; PREDICTED], PipelineError> {
        let values: Vec<f32> = window.crops.iter().flatten().map(|v| f32::from(*v)).collect();
        let failed = |session: &Session, what: &str| InferError::Failed {
            model: session.card().name.clone(),
            what: what.to_owned(),
        };
        let values = ArrayView5::from_shape((1, STEPS, SIDE_PX, SIDE_PX, 3), &values)
            .map_err(|_shape| failed(&self.session, "a window is not complete"))?;
        let outputs = self.session.run(&[NamedTensor { name: "crops", values: values.into_dyn() }])?;
        let labels = outputs.get("labels");
        let labels = labels.as_ref().and_then(|labels| labels.as_slice());
        let labels = labels.and_then(|labels| ArrayView2::from_shape((PREDICTED, LABELS), labels).ok());
        let labels = labels.ok_or_else(|| failed(&self.session, "the output labels is of another shape"))?;
        Ok(std::array::from_fn(|step| std::array::from_fn(|label| f64::from(labels[[step, label]]))))
    }
}

/// Returns windows that together predict every time step of a track exactly once.
fn windows_of(track: u64, boxes: &Boxes) -> Vec<Window> {
    let (Some((first_s, _)), Some((last_s, _))) = (boxes.first(), boxes.last()) else { return Vec::new() };
    let steps = grid(*first_s, *last_s);
    let predicted = PREDICTED as i64;
    let window_of = |step: i64| (step + PREDICTED_BEFORE).div_euclid(predicted);
    (window_of(*steps.start())..=window_of(*steps.end()))
        .map(|k| {
            let step = k * predicted;
            let time_s = step as f64 * STEP_S;
            let off_s = |i: usize| (boxes[i].0 - time_s).abs();
            let after = boxes.partition_point(|(t, _)| *t < time_s).min(boxes.len() - 1);
            let before = after.saturating_sub(1);
            let nearest = if off_s(before) < off_s(after) { before } else { after };
            let square = Square::around(boxes[nearest].1);
            Window { track, step, square, crops: vec![Vec::new(); STEPS] }
        })
        .collect()
}

/// Cuts the crops of all windows out of a video. The crop of a time step comes from the frame nearest in time.
///
/// A time step without a frame repeats the previous crop. Time steps before the start of the video repeat the first
/// crop.
fn cut_all(media: &Path, windows: &mut [Window]) -> Result<(), PipelineError> {
    let mut off_s: BTreeMap<i64, f64> = BTreeMap::new();
    let mut input = open(media, &DecodeOptions::default())?;
    while let Some(frame) = input.next_frame()? {
        let time_s = frame.stamp.time_s();
        let step = (time_s / STEP_S).round() as i64;
        let off = (time_s - step as f64 * STEP_S).abs();
        if off_s.get(&step).is_some_and(|nearest| *nearest <= off) {
            continue;
        }
        off_s.insert(step, off);
        for window in windows.iter_mut() {
            let index = usize::try_from(step - window.step + BEFORE).ok();
            if let Some(crop) = index.and_then(|index| window.crops.get_mut(index)) {
                crop.resize(CROP_BYTES, 0);
                window.square.cut(&frame.image, crop);
            }
        }
    }
    for window in windows {
        let there = |crop: &Vec<u8>| !crop.is_empty();
        let Some(first) = window.crops.iter().find(|crop| there(crop)) else { continue };
        let mut last = first.clone();
        for crop in &mut window.crops {
            if there(crop) {
                last.clone_from(crop);
            } else {
                crop.clone_from(&last);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    #[test]
    fn every_step_of_a_track_is_predicted_once() {
        for (first, last) in [(0, 0), (3, 40), (7, 8), (101, 1300)] {
            let boxes: Boxes = (first..=last)
                .map(|i| (f64::from(i) / 30.0, [f64::from(i), 0.0, f64::from(i) + 20.0, 10.0]))
                .collect();
            let windows = windows_of(5, &boxes);
            let steps = windows.iter().flat_map(|w| (w.step - PREDICTED_BEFORE..).take(PREDICTED));
            let predicted: Vec<i64> = steps.collect();
            assert!(predicted.windows(2).all(|pair| pair[1] == pair[0] + 1));
            assert!(grid(boxes[0].0, boxes[boxes.len() - 1].0).all(|step| predicted.contains(&step)));
            for window in &windows {
                // There are 6 frames per time step.
                let frame = (window.step * 6).clamp(first.into(), last.into()) as f64;
                assert_eq!(window.square, Square::around([frame, 0.0, frame + 20.0, 10.0]));
            }
        }
        assert!(windows_of(5, &Vec::new()).is_empty());
    }

    #[test]
    fn a_window_shows_the_frames_nearest_to_its_steps() {
        let folder = tempfile::tempdir().unwrap();
        for i in 0..90_u8 {
            let path = folder.path().join(format!("{i:03}.png"));
            RgbImage::from_pixel(40, 30, Rgb([i, 0, 255 - i])).save(path).unwrap();
        }
        // A folder counts as 30 pictures per second, so a time step has 6 pictures.
        let mut windows =
            windows_of(1, &vec![(0.0, [10.0, 10.0, 20.0, 20.0]), (0.4, [12.0, 10.0, 22.0, 20.0])]);
        cut_all(folder.path(), &mut windows).unwrap();
        let brightness: Vec<u8> = windows[0].crops.iter().map(|crop| crop[0]).collect();
        assert_eq!(windows[0].step, 0);
        assert_eq!(brightness, [0, 0, 0, 0, 0, 0, 0, 0, 0, 6, 12, 18, 24, 30, 36, 42]);
        assert!(windows.iter().all(|window| window.crops.iter().all(|crop| crop.len() == CROP_BYTES)));
    }
}
