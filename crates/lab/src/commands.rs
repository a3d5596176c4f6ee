//! One file or folder per command; each turns arguments into a call of the library and prints its tables.

pub mod bench;
pub mod eval;
pub mod synth;
