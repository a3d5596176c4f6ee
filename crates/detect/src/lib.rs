//! roadplane: detect.
