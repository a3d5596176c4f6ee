//! roadplane: solve.
