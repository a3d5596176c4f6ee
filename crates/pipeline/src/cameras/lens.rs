//! A clip's lens: told, remembered, or shown by long edges of the place; otherwise straight.

use roadplane_base::{Camera, ImageSize, Lens, SceneCurve};
use roadplane_calibrate::{FuseOptions, LensView, WindowEstimate, fuse};

use crate::cameras::memory::Recall;
use crate::{CameraConstraints, Config};

/// sd of a lens' bend that is told.
const TOLD_BEND_SD: f64 = 0.005;

/// What a clip is solved with, and how far that may be off.
#[derive(Clone, Debug)]
pub(crate) struct LensOfClip {
    lens: Lens,
    bend_sd: Option<f64>,
    /// What the edges say, where nothing else does.
    view: Option<LensView>,
    size: ImageSize,
}

impl LensOfClip {
    /// By the first of these that says something.
    pub(crate) fn new(
        curves: &[SceneCurve],
        size: ImageSize,
        known: &CameraConstraints,
        recall: Option<&Recall>,
        config: &Config,
    ) -> Self {
        let straight = Self { lens: Lens::STRAIGHT, bend_sd: None, view: None, size };
        if let Some(lens) = known.lens(size) {
            return Self { lens, bend_sd: Some(TOLD_BEND_SD), ..straight };
        }
        if !config.solve.use_lens {
            return straight;
        }
        let view = LensView::of(curves, size);
        let prior = config.solve.scene_options(known.focal_px()).camera_prior;
        let log_focal =
            known.focal_px().map_or([prior.mean(size).log_focal, prior.log_focal_sd], |f| [f.ln(), 0.0]);
        let here = view.found(log_focal).map(|found| {
            tracing::info!(
                "the lens bends lines by {:.3} ± {:.3} at the picture's side",
                found.lens.bend(size),
                found.bend_sd
            );
            (found.lens, found.bend_sd)
        });
        let bend_sd = |lens: Lens| lens.bend(size);
        let before = recall.iter().flat_map(|recall| &recall.evidence);
        let before = before.filter(|said| said.image_size_px == size).filter_map(|said| said.lens);
        let all = here.into_iter().chain(before.map(|(lens, sd)| (lens, bend_sd(Lens { per_px2: sd }))));
        // The same place shows the same edges every night: the surest one, not their mean.
        match all.reduce(|a, b| if b.1 < a.1 { b } else { a }) {
            Some((lens, sd)) => Self { lens, bend_sd: Some(sd), view: Some(view), size },
            None => Self { view: Some(view), ..straight },
        }
    }

    pub(crate) fn lens(&self) -> Lens {
        self.lens
    }

    /// sd of the bend, where something said it.
    pub(crate) fn bend_sd(&self) -> Option<f64> {
        self.bend_sd
    }

    /// Counts what is not known of lens and principal point as errors that cars share. Where nothing was said of it that depends on how wide the
    /// picture is, which the windows tell.
    pub(crate) fn count(&self, windows: &[WindowEstimate], options: FuseOptions) -> FuseOptions {
        let mut options = FuseOptions { lens: self.lens, bend_sd: self.bend_sd, ..options };
        let rough = fuse(windows, &options.for_cars()).into_iter().next();
        let log_focal = rough.map_or([options.prior.params.log_focal, options.prior.sd[0]], |camera| {
            [camera.params.log_focal, camera.covariance[(0, 0)].max(0.0).sqrt()]
        });
        let silent = || self.view.as_ref().map_or(0.0, |view| view.sd_about(self.lens, log_focal));
        let bend_sd = self.bend_sd.unwrap_or_else(silent);
        let point_sd_px = Camera::PRINCIPAL_POINT_SD * f64::from(self.size.width);
        options.shared_sd[2] = Lens::with_bend(bend_sd, self.size).per_px2;
        options.shared_sd[3..].fill(point_sd_px);
        options
    }
}
