//! Runs the detection net on whole frames and on parts of frames.

use image::RgbImage;
use ndarray::{Array4, Axis, Ix4};
use roadplane_base::{CarRecord, Frame, VehicleClass};
use roadplane_infer::{Dim, NamedTensor, Session};

use crate::decode::{BINS, CLASSES, Candidate, FEWEST_CLASSES, candidates};
use crate::merge::{Found, merge};
use crate::resample::{Part, input};
use crate::tiles::{cuts, tiles};
use crate::{DetectError, DetectOptions};

/// Side of a grid cell in each output level of the net, px of the net's input.
const STRIDES_PX: [usize; 3] = [8, 16, 32];
/// Margin at a border, px of the net's input. A box that ends within this margin counts as cut by the border. Boxes
/// that the border cuts seldom end exactly on it.
const NEAR_BORDER_PX: f64 = 4.0;
/// Lowest score of a box that takes part in merging.
const MIN_CANDIDATE_SCORE: f64 = 0.1;

/// The boxes detected in a part of a picture, from one or more passes.
pub(crate) struct Detections {
    /// Boxes that show whole vehicles. They are not merged.
    pub found: Vec<Candidate>,
    /// Boxes that are probably cut by a border of the part. They are not merged. The picture's own borders do not
    /// count.
    pub cut: Vec<Candidate>,
}

/// Finds vehicles in frames.
#[derive(Debug)]
pub struct Detector {
    session: Session,
    /// Number of classes of the net, the first ones of `CLASSES`.
    classes: usize,
    options: DetectOptions,
}

impl Detector {
    /// Creates a detector from the session of its net.
    ///
    /// # Errors
    /// [`DetectError::UnsuitableNet`] if the model card does not describe the outputs that this code reads.
    /// [`DetectError::Option`] if an option is out of its range.
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
        let classes = card.extra.get("classes").and_then(|classes| classes.as_array());
        let classes: Vec<&str> = classes.into_iter().flatten().filter_map(|name| name.as_str()).collect();
        if classes.len() < FEWEST_CLASSES || !CLASSES.map(VehicleClass::name).starts_with(&classes) {
            return Err(unsuitable("its classes must be car, truck, bus and perhaps motorcycle".to_owned()));
        }
        for stride in STRIDES_PX {
            for (kind, expected) in [("scores", classes.len()), ("bins", 4 * BINS)] {
                let name = format!("{kind}_{stride}");
                let shape = card.output(&name).map(|spec| spec.shape.as_slice());
                if channels(shape) != Some(expected) {
                    return Err(unsuitable(format!(
                        "it needs an output {name} [batch, {expected}, rows, columns]"
                    )));
                }
            }
        }
        let classes = classes.len();
        Ok(Self { session, classes, options })
    }

    /// Returns the classes that the net distinguishes.
    #[must_use]
    pub fn classes(&self) -> &'static [VehicleClass] {
        &VehicleClass::ALL[..self.classes]
    }

    /// Returns the session of the net.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Returns the vehicles in a whole frame, highest score first. Boxes end at the frame's borders.
    ///
    /// # Errors
    /// [`DetectError::Net`] when the net fails or returns numbers that are not finite.
    pub fn detect(&mut self, frame: &Frame) -> Result<Vec<CarRecord>, DetectError> {
        let (width, height) = (frame.image.width(), frame.image.height());
        let mut scales = self.options.scales(width, height);
        scales.extend(self.options.fine(width, height).map(|fine| fine.scale));
        let detections = self.inspect(&frame.image, Part::whole(&frame.image), &scales)?;
        let found = merge(detections.found, &self.options, self.options.min_score);
        Ok(found.into_iter().filter_map(|f| record(f, f64::from(width), f64::from(height))).collect())
    }

    /// Returns the options.
    pub(crate) fn options(&self) -> &DetectOptions {
        &self.options
    }

    /// Returns the boxes of vehicles in a part of a picture, one pass for each scale. They are in px from the top-left
    /// corner of the whole picture.
    pub(crate) fn inspect(
        &mut self,
        image: &RgbImage,
        part: Part,
        scales: &[f64],
    ) -> Result<Detections, DetectError> {
        let (mut found, mut cut) = (Vec::new(), Vec::new());
        for scale in scales {
            let (longest, overlap) = (self.options.tile_px as f64, self.options.tile_overlap_px as f64);
            let to_frame = |px: f64| (px / scale).round() as usize;
            for tile in tiles(part, to_frame(longest), to_frame(overlap)) {
                let side = |length: usize| ((length as f64 * scale).round() as usize).max(1);
                let (width, height) = (side(tile.width), side(tile.height));
                let input = input(image, tile, width, height).map_err(DetectError::picture)?;
                let (scale_x, scale_y) =
                    (width as f64 / tile.width as f64, height as f64 / tile.height as f64);
                for mut candidate in self.run(&input)? {
                    let [x0, y0, x1, y1] = candidate.bbox;
                    let (left, top) = (tile.x as f64, tile.y as f64);
                    candidate.bbox =
                        [x0 / scale_x + left, y0 / scale_y + top, x1 / scale_x + left, y1 / scale_y + top];
                    if cuts(tile, candidate.bbox, Part::whole(image), NEAR_BORDER_PX / scale) {
                        cut.push(candidate);
                    } else {
                        found.push(candidate);
                    }
                }
            }
        }
        Ok(Detections { found, cut })
    }

    fn run(&mut self, image: &Array4<f32>) -> Result<Vec<Candidate>, DetectError> {
        let outputs = self.session.run(&[NamedTensor { name: "image", values: image.view().into_dyn() }])?;
        let mut found = Vec::new();
        for stride in STRIDES_PX {
            let output = |kind: &str| {
                let name = format!("{kind}_{stride}");
                outputs.get(&name).and_then(|array| array.into_dimensionality::<Ix4>().ok())
            };
            // The constructor checked that the card lists these outputs, and the session checks the outputs against the
            // card.
            let (Some(scores), Some(bins)) = (output("scores"), output("bins")) else { continue };
            found.extend(candidates(
                &scores.index_axis(Axis(0), 0),
                &bins.index_axis(Axis(0), 0),
                stride as f64,
                MIN_CANDIDATE_SCORE,
            ));
        }
        Ok(found)
    }
}

/// Returns the record of a vehicle, or `None` if its box is outside the frame.
///
/// The box is cut at the frame's borders. In the record, coordinates count from the centre of the top-left pixel.
pub(crate) fn record(found: Found, width: f64, height: f64) -> Option<CarRecord> {
    let [x0, y0, x1, y1] = found.bbox;
    let clamp = |value: f64, length: f64| value.clamp(0.0, length) - 0.5;
    let bbox_px = [clamp(x0, width), clamp(y0, height), clamp(x1, width), clamp(y1, height)];
    let has_area = bbox_px[2] > bbox_px[0] && bbox_px[3] > bbox_px[1];
    has_area.then(|| CarRecord {
        score: (found.score * 1e4).round() / 1e4,
        class: found.class,
        ..CarRecord::boxed(bbox_px.map(|v| (v * 100.0).round() / 100.0))
    })
}
