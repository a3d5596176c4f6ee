//! Least squares, independent of cars: the descent, the arrow-shaped normal equations, and their sums four rows at a
//! time.

pub(crate) mod arrow;
pub(crate) mod gram;
pub(crate) mod lanes;
pub(crate) mod lm;
