//! How large the cars of a place are against those of the shape atlas.

/// sd of the mean size of a place's cars against the shape atlas', log: those of the USA are some 6 % longer than Europe's,
/// Japan's as much shorter (estimates). Every car of a clip shares it, and heights and distances scale with it.
pub(crate) const POPULATION_LOG_SD: f64 = 0.04;
