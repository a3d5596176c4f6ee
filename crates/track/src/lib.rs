//! roadplane: track.
