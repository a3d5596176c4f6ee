//! The size of a site's cars relative to the shape atlas.

/// Sd of the log of the mean size of a site's cars relative to the shape atlas.
///
/// Cars in the USA are about 6 % longer than those in Europe, cars in Japan about as much shorter (estimates). Every
/// car of a clip shares this error, and heights and distances scale with it.
pub(crate) const POPULATION_LOG_SD: f64 = 0.04;
