//! `roadplane eval`, `bench` and `synth`: start `roadplane-lab` with the same arguments.

use std::os::unix::process::CommandExt as _;

use anyhow::Context as _;
use roadplane_terminal::Outcome;

/// Name of the laboratory program.
const LAB: &str = "roadplane-lab";

/// Replaces this process by `roadplane-lab`, from the folder of this program or from PATH.
pub fn lab() -> anyhow::Result<Outcome> {
    let beside = std::env::current_exe()?.with_file_name(LAB);
    let program = if beside.is_file() { beside } else { LAB.into() };
    let error = std::process::Command::new(&program).args(std::env::args_os().skip(1)).exec();
    Err(error).with_context(|| {
        format!(
            "eval, bench and synth need {LAB} beside this program or in PATH; {} does not start",
            program.display()
        )
    })
}
