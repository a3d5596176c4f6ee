//! What must be known of the camera before its frames can be converted: the lens, and where its pictures lie.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use roadplane_base::{FrameRecord, ShapeAtlas};
use roadplane_calibrate::{OneCamera, Places, PlacesBuilder, TurnedLensBuilder};
use roadplane_write::{FrameReader, LensTraces, read_lens_traces};

use crate::cameras::estimate::estimate_cameras;
use crate::cameras::lens::LensOfClip;
use crate::cameras::memory::CameraHistory;
use crate::{CameraConstraints, Config, PipelineError};

/// The lens of a clip, and the places that its pictures show.
#[derive(Clone, Debug, Default)]
pub(crate) struct Optics {
    /// The lens; `None` for a clip without frames.
    pub lens: Option<LensOfClip>,
    /// Where the reference pictures of a moving camera lie.
    pub places: Arc<Places>,
}

impl Optics {
    /// Estimates the lens and the places from a file of frames.
    ///
    /// # Errors
    /// Errors of reading the file; [`PipelineError::Usage`] where constraints belong to other pictures.
    pub(crate) fn of(
        frames: &Path,
        known: &CameraConstraints,
        recall: Option<&CameraHistory>,
        atlas: &ShapeAtlas,
        config: &Config,
    ) -> Result<Self, PipelineError> {
        let mut turned = TurnedLensBuilder::default();
        let LensTraces { image_size_px, curves } =
            read_lens_traces(frames, |registration| turned.push(registration))?;
        let Some(size) = image_size_px else { return Ok(Self::default()) };
        let known = known.for_pictures(size)?;
        let mut lens = LensOfClip::new(&curves, turned.finish(), size, &known, recall, config);
        let places = |lens: &LensOfClip, span_s: f64| -> Result<Arc<Places>, PipelineError> {
            let mut builder = PlacesBuilder::new(lens.lens(), lens.turned());
            for frame in within(FrameReader::open(frames)?, span_s) {
                builder.push(&frame?);
            }
            Ok(Arc::new(builder.finish()))
        };
        if lens.is_of_edges() {
            // The first window shows whether the cars' focal length suits the lens.
            let window_s = config.calibrate.window_s;
            let optics = Self { places: places(&lens, window_s)?, lens: Some(lens.clone()) };
            let first =
                within(FrameReader::open(frames)?, window_s).map(|frame| frame.map_err(PipelineError::from));
            let (known, _) = known.with_frames(&BTreeMap::new());
            let cameras = estimate_cameras(optics.convert(first), &optics, atlas, &known, None, config)?;
            if let Some(camera) = cameras.estimates().first() {
                lens = lens.beside([camera.params.log_focal, camera.covariance[(0, 0)].max(0.0).sqrt()]);
            }
        }
        Ok(Self { places: places(&lens, f64::INFINITY)?, lens: Some(lens) })
    }

    /// Converts frames to those of one camera.
    pub(crate) fn convert<I>(&self, frames: I) -> OneCamera<I> {
        OneCamera::new(frames, Arc::clone(&self.places))
    }
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
