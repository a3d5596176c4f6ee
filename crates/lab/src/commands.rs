//! The commands, one file or folder for each. A command calls the library with its arguments and prints the resulting
//! tables.

pub mod bench;
pub mod eval;
pub mod synth;
