//! General least squares: the descent, the arrow-shaped normal equations, and their vectorised sums.

pub(crate) mod arrow;
pub(crate) mod gram;
pub(crate) mod lanes;
pub(crate) mod lm;
