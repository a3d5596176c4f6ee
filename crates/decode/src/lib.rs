//! roadplane: decode.
