//! Options for joining windows and clips: the prior, and the factors that count once.

use std::collections::BTreeMap;

use roadplane_base::ImageSize;
use roadplane_calibrate::{Factor, FuseOptions};

use crate::Config;
use crate::cameras::known::CameraConstraints;

/// Sd of the log of the mean size of a site's cars relative to the shape atlas.
///
/// Cars in the USA are about 6 % longer than those in Europe, cars in Japan about as much shorter (estimates). Every
/// car of a clip shares this error, and heights and distances scale with it.
pub(crate) const POPULATION_LOG_SD: f64 = 0.04;

/// Returns the options for joining windows and clips, for a camera with this number of positions.
pub(crate) fn fuse_options(
    size: ImageSize,
    positions: usize,
    known: &CameraConstraints,
    config: &Config,
) -> FuseOptions {
    let options = config.solve.scene_options(known.focal_px());
    FuseOptions {
        shared_sd: options.shared_sd(),
        factors: factors_by_position(size, positions, known),
        size_of_cars_sd: POPULATION_LOG_SD,
        ..FuseOptions::new(size, &options.camera_prior, options.given_focal_px)
    }
}

/// Returns all factors beside the cars, by camera position.
pub(crate) fn factors_by_position(
    size: ImageSize,
    positions: usize,
    known: &CameraConstraints,
) -> BTreeMap<usize, Vec<Factor>> {
    let factors = (0..positions).map(|position| (position, known.factors(position, size)));
    factors.filter(|(_, factors)| !factors.is_empty()).collect()
}
