//! roadplane: write.
