//! The `roadplane` binary.
fn main() {}
