//! The detector.

use ndarray::{Array4, Axis, Ix4, s};
use roadplane_base::{CarRecord, Frame};
use roadplane_infer::{Dim, NamedTensor, Session};

use crate::decode::{BINS, CLASSES, Candidate, candidates};
use crate::merge::{Found, merge};
use crate::resample::{Planes, resample};
use crate::tiles::{Tile, tiles};
use crate::{DetectError, DetectOptions};

/// Cell sizes of the net's levels, px of its input.
const STRIDES_PX: [usize; 3] = [8, 16, 32];
/// Sides of the net's input are multiples of this.
const MULTIPLE_PX: usize = 32;
/// What fills the input beyond the picture: the middle grey that the net was trained with.
const PADDING: f32 = 114.0 / 255.0;
/// Weakest score that takes part in merging.
const MIN_CANDIDATE_SCORE: f64 = 0.1;

/// Finds vehicles in frames.
#[derive(Debug)]
pub struct Detector {
    session: Session,
    options: DetectOptions,
}

impl Detector {
    /// A detector on this net.
    ///
    /// # Errors
    /// [`DetectError::UnsuitableNet`] when the net's card does not describe what this code reads,
    /// [`DetectError::Option`] for options out of range.
    pub fn new(session: Session, options: DetectOptions) -> Result<Self, DetectError> {
        options.check()?;
        let card = session.card();
        let unsuitable = |what: String| DetectError::UnsuitableNet { model: card.name.clone(), what };
        let channels = |shape: Option<&[Dim]>| match shape {
            Some([_, Dim::Fixed(channels), _, _]) => Some(*channels),
            _ => None,
        };
        let input = card.input("image").map(|spec| spec.shape.as_slice());
        if card.inputs.len() != 1 || channels(input) != Some(3) {
            return Err(unsuitable("it needs one input image [batch, 3, height, width]".to_owned()));
        }
        for stride in STRIDES_PX {
            for (kind, expected) in [("scores", CLASSES.len()), ("bins", 4 * BINS)] {
                let name = format!("{kind}_{stride}");
                let shape = card.output(&name).map(|spec| spec.shape.as_slice());
                if channels(shape) != Some(expected) {
                    return Err(unsuitable(format!(
                        "it needs an output {name} [batch, {expected}, rows, columns]"
                    )));
                }
            }
        }
        let classes = card.extra.get("classes").and_then(|classes| classes.as_array());
        let names = classes.map(|names| names.iter().filter_map(|name| name.as_str()).collect::<Vec<_>>());
        if names.as_deref() != Some(&["car", "truck", "bus"]) {
            return Err(unsuitable("its classes must be car, truck, bus".to_owned()));
        }
        Ok(Self { session, options })
    }

    /// The net.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Finds the vehicles of a frame, best first. Boxes are within the frame.
    ///
    /// # Errors
    /// [`DetectError::Net`] when the net fails or returns numbers that are not finite.
    pub fn detect(&mut self, frame: &Frame) -> Result<Vec<CarRecord>, DetectError> {
        let (width, height) = (f64::from(frame.image.width()), f64::from(frame.image.height()));
        let mut found = Vec::new();
        let scales = self.options.scales(frame.image.width(), frame.image.height());
        for (pass, scale) in scales.iter().enumerate() {
            let side = |length: f64| ((length * scale).round() as usize).max(1);
            let planes = resample(&frame.image, side(width), side(height));
            let (scale_x, scale_y) = (planes.width as f64 / width, planes.height as f64 / height);
            for mut candidate in self.look(&planes, pass)? {
                let [x0, y0, x1, y1] = candidate.bbox;
                candidate.bbox = [x0 / scale_x, y0 / scale_y, x1 / scale_x, y1 / scale_y];
                found.push(candidate);
            }
        }
        let records =
            merge(found, &scales, &self.options).into_iter().filter_map(|f| record(f, width, height));
        Ok(records.collect())
    }

    /// One pass: all tiles of a scaled frame; boxes from its corner.
    fn look(&mut self, planes: &Planes, pass: usize) -> Result<Vec<Candidate>, DetectError> {
        let (longest, overlap) = (self.options.tile_px as usize, self.options.tile_overlap_px as usize);
        let picture = (planes.width, planes.height);
        let mut found = Vec::new();
        for tile in tiles(planes.width, planes.height, longest, overlap) {
            for mut candidate in self.run(&cut(planes, tile), pass)? {
                let (x, y) = (tile.x as f64, tile.y as f64);
                let [x0, y0, x1, y1] = candidate.bbox;
                candidate.bbox = [x0 + x, y0 + y, x1 + x, y1 + y];
                if !tile.cuts(candidate.bbox, picture) {
                    found.push(candidate);
                }
            }
        }
        Ok(found)
    }

    fn run(&mut self, image: &Array4<f32>, pass: usize) -> Result<Vec<Candidate>, DetectError> {
        let outputs = self.session.run(&[NamedTensor { name: "image", values: image.view().into_dyn() }])?;
        let mut found = Vec::new();
        for stride in STRIDES_PX {
            let output = |kind: &str| {
                let name = format!("{kind}_{stride}");
                outputs.get(&name).and_then(|array| array.into_dimensionality::<Ix4>().ok())
            };
            // The card was checked for them, and the session checks outputs against the card.
            let (Some(scores), Some(bins)) = (output("scores"), output("bins")) else { continue };
            found.extend(candidates(
                &scores.index_axis(Axis(0), 0),
                &bins.index_axis(Axis(0), 0),
                stride as f64,
                MIN_CANDIDATE_SCORE,
                pass,
            ));
        }
        Ok(found)
    }
}

/// The tile as the net's input, padded at the right and the bottom.
fn cut(planes: &Planes, tile: Tile) -> Array4<f32> {
    let padded = |length: usize| length.next_multiple_of(MULTIPLE_PX);
    let mut image = Array4::from_elem((1, 3, padded(tile.height), padded(tile.width)), PADDING);
    for channel in 0..3 {
        for row in 0..tile.height {
            let from = (channel * planes.height + tile.y + row) * planes.width + tile.x;
            let source = ndarray::ArrayView1::from(&planes.values[from..from + tile.width]);
            image.slice_mut(s![0, channel, row, ..tile.width]).assign(&source);
        }
    }
    image
}

/// The record of a vehicle, its box moved to pixel centres and cut at the frame; `None` if nothing of it is inside.
fn record(found: Found, width: f64, height: f64) -> Option<CarRecord> {
    let [x0, y0, x1, y1] = found.bbox;
    let clamp = |value: f64, length: f64| value.clamp(0.0, length) - 0.5;
    let bbox_px = [clamp(x0, width), clamp(y0, height), clamp(x1, width), clamp(y1, height)];
    let has_area = bbox_px[2] > bbox_px[0] && bbox_px[3] > bbox_px[1];
    has_area.then(|| CarRecord {
        bbox_px: bbox_px.map(|v| (v * 100.0).round() / 100.0),
        score: (found.score * 1e4).round() / 1e4,
        class: found.class,
        keypoints: None,
        extra: serde_json::Map::new(),
    })
}
