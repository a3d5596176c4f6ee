//! roadplane: infer.
