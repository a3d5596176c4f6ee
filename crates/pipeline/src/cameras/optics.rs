//! The facts of the camera that are needed before its frames can be converted: the lens, and where its pictures lie.

use std::path::Path;
use std::sync::Arc;

use roadplane_calibrate::{OneCamera, Places, PlacesBuilder, TurnedLensBuilder};
use roadplane_write::{FrameReader, LensTraces, read_lens_traces};

use crate::cameras::database::CameraHistory;
use crate::cameras::lens::LensOfClip;
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
        history: Option<&CameraHistory>,
        config: &Config,
    ) -> Result<Self, PipelineError> {
        let mut turned = TurnedLensBuilder::default();
        let LensTraces { image_size_px, curves } =
            read_lens_traces(frames, |registration| turned.push(registration))?;
        let Some(size) = image_size_px else { return Ok(Self::default()) };
        let known = known.for_pictures(size)?;
        let lens = LensOfClip::new(&curves, turned.finish(), size, &known, history, config);
        Self::with_lens(lens, frames)
    }

    /// Estimates the places from a file of frames, seen through a lens.
    ///
    /// # Errors
    /// Errors of reading the file.
    pub(crate) fn with_lens(lens: LensOfClip, frames: &Path) -> Result<Self, PipelineError> {
        let mut builder = PlacesBuilder::new(lens.lens, lens.turned);
        for frame in FrameReader::open(frames)? {
            builder.push(&frame?);
        }
        Ok(Self { lens: Some(lens), places: Arc::new(builder.finish()) })
    }

    /// Converts frames to those of one camera.
    pub(crate) fn convert<I>(&self, frames: I) -> OneCamera<I> {
        OneCamera::new(frames, Arc::clone(&self.places))
    }
}
