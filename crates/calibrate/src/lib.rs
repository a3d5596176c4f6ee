//! roadplane: calibrate.
