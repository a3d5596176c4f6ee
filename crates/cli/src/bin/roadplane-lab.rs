//! The `roadplane-lab` binary. It is a target of this crate, so one Python wheel contains both programs.

use std::process::ExitCode;

fn main() -> ExitCode {
    roadplane_lab::run_program()
}
