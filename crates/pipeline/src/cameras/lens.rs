//! The lens of a clip. The user gives it, or it is stored, or it is estimated from long edges of the site and turns of the
//! camera. Otherwise it has no distortion.

use roadplane_base::{Camera, CameraEstimate, ImageSize, Lens, SceneCurve};
use roadplane_calibrate::{FuseOptions, LensView, LogFocal, STRAIGHT_SD, TurnedLens, WindowEstimate, fuse};

use crate::cameras::database::CameraHistory;
use crate::{CameraConstraints, Config};

/// The lens that a clip is solved with, and its uncertainty.
#[derive(Clone, Debug)]
pub(crate) struct LensOfClip {
    /// The lens.
    pub(crate) lens: Lens,
    /// Sd of the distortion (dimensionless); `None` where nothing determines the lens.
    pub(crate) distortion_sd: Option<f64>,
    /// Whether the lens comes from edges or turns of this clip.
    pub(crate) is_of_clip: bool,
    /// Mean and sd of the distortion without the edges (dimensionless).
    pub(crate) turned: [f64; 2],
    /// Likelihood of the distortion given the edges alone, and given edges and turns. `None` where the user or the
    /// configuration determines the lens.
    views: Option<[LensView; 2]>,
}

impl LensOfClip {
    /// Takes the lens of the user. Without one, takes the most certain lens of the edges and turns and of the camera
    /// database.
    pub(crate) fn new(
        curves: &[SceneCurve],
        turned: Option<TurnedLens>,
        size: ImageSize,
        known: &CameraConstraints,
        history: Option<&CameraHistory>,
        config: &Config,
    ) -> Self {
        let straight = Self {
            lens: Lens::STRAIGHT,
            distortion_sd: None,
            is_of_clip: false,
            turned: [0.0; 2],
            views: None,
        };
        if let Some(lens) = known.lens(size) {
            let turned = [lens.distortion(size), STRAIGHT_SD];
            return Self { lens, distortion_sd: Some(STRAIGHT_SD), turned, ..straight };
        }
        if !config.solve.use_lens {
            return straight;
        }
        let edges = LensView::of(curves, None, size);
        let both = turned.map_or_else(|| edges.clone(), |turned| LensView::of(curves, Some(turned), size));
        let views = [edges, both];
        let prior = config.solve.scene_options(known.focal_px()).camera_prior;
        let log_focal =
            known.focal_px().map_or([prior.mean(size).log_focal, prior.log_focal_sd], |f| [f.ln(), 0.0]);
        let here = found(&views, log_focal);
        if let Some((lens, sd)) = here {
            tracing::info!(
                "the lens distortion is {:.3} ± {sd:.3} at the picture's side",
                lens.distortion(size)
            );
        }
        let turned = LensView::of(&[], turned, size).distortion(log_focal).unwrap_or_default();
        let before = history.iter().flat_map(|history| &history.evidence);
        let before = before.filter(|said| said.image_size_px == size).filter_map(|said| said.lens);
        let all =
            here.into_iter().chain(before.map(|(lens, sd)| (lens, Lens { per_px2: sd }.distortion(size))));
        // The same site shows the same edges every night. So the most certain lens is used, not the mean.
        match all.reduce(|a, b| if b.1 < a.1 { b } else { a }) {
            Some((lens, sd)) => {
                let is_of_clip = here == Some((lens, sd));
                Self { lens, distortion_sd: Some(sd), is_of_clip, turned, views: Some(views) }
            }
            None => Self { turned, views: Some(views), ..straight },
        }
    }

    /// Whether the edges and turns still show a lens with the focal length of an estimated camera.
    ///
    /// Edges alone may look like those of a wide-angle lens, for example on a curved road. The cars then show that the
    /// view is too narrow for such a distortion.
    pub(crate) fn suits(&self, camera: &CameraEstimate) -> bool {
        self.views.as_ref().is_none_or(|views| found(views, log_focal_of(camera)).is_some())
    }

    /// Returns the same edges and turns without a lens.
    pub(crate) fn without_distortion(self) -> Self {
        Self { lens: Lens::STRAIGHT, distortion_sd: None, is_of_clip: false, ..self }
    }

    /// Adds the uncertainty of the lens and of the principal point to the errors that all cars share.
    ///
    /// If nothing determines the lens, its uncertainty depends on the width of the view, which the windows determine.
    pub(crate) fn count(&self, windows: &[WindowEstimate], options: FuseOptions) -> FuseOptions {
        let mut options = FuseOptions { lens: self.lens, distortion_sd: self.distortion_sd, ..options };
        let rough = fuse(windows, &options.for_cars()).into_iter().next();
        let log_focal =
            rough.map_or([options.prior.log_focal, options.prior_sd[0]], |camera| log_focal_of(&camera));
        let sd_if_open = || self.views.as_ref().map_or(0.0, |[_, both]| both.sd_about(self.lens, log_focal));
        let distortion_sd = self.distortion_sd.unwrap_or_else(sd_if_open);
        let size = options.image_size_px;
        let point_sd_px = Camera::PRINCIPAL_POINT_SD * f64::from(size.width);
        options.shared_sd[2] = Lens::with_distortion(distortion_sd, size).per_px2;
        options.shared_sd[3..].fill(point_sd_px);
        options
    }
}

/// Returns the lens that the edges show or, if they show none, that edges and turns show together.
///
/// Where edges and turns contradict each other, the lens is that of the edges, as for a camera at rest.
fn found([edges, both]: &[LensView; 2], log_focal: LogFocal) -> Option<(Lens, f64)> {
    edges.found(log_focal).or_else(|| both.found(log_focal))
}

/// Returns the log focal length (px) of a camera, and its sd.
fn log_focal_of(camera: &CameraEstimate) -> LogFocal {
    [camera.params.log_focal, camera.covariance[(0, 0)].max(0.0).sqrt()]
}
