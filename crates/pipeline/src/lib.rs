//! roadplane: pipeline.
