//! The `roadplane-lab` binary. It is a target of this crate, so that one wheel holds both programs.

use std::process::ExitCode;

fn main() -> ExitCode {
    roadplane_lab::run_program()
}
