//! Exit codes of the programs. The book's chapter "When it fails" documents them.

use std::os::unix::process::CommandExt as _;
use std::process::ExitCode;

use roadplane_pipeline::{Fault, too_small_address_space};

use crate::Outcome;

/// Exit code for input that is damaged, lost or only partly followed. Results are still written for all other parts.
const DAMAGED: u8 = 3;

/// Returns the exit code for the outcome of a command, and logs the error if the command failed.
///
/// `fault_of` returns the kind of fault that an error has; the exit code depends on this kind.
pub fn exit_code(
    outcome: anyhow::Result<Outcome>,
    fault_of: impl Fn(&anyhow::Error) -> Option<Fault>,
) -> ExitCode {
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Damaged) => ExitCode::from(DAMAGED),
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{}", message(&error));
            ExitCode::from(code(fault_of(&error)))
        }
    }
}

/// Joins the messages of an error and of its causes. A cause is left out if the text already contains its message.
fn message(error: &anyhow::Error) -> String {
    error.chain().fold(String::new(), |text, cause| match cause.to_string() {
        cause if text.contains(&cause) => text,
        cause if text.is_empty() => cause,
        cause => format!("{text}: {cause}"),
    })
}

fn code(fault: Option<Fault>) -> u8 {
    match fault {
        Some(Fault::Usage) => 2,
        Some(Fault::Input) => DAMAGED,
        Some(Fault::Model) => 4,
        Some(Fault::Locked) => 11,
        Some(Fault::Stopped { signal }) => u8::try_from(128 + signal).unwrap_or(1),
        Some(Fault::Internal) | None => 1,
    }
}

/// Returns whether the program that reads our output has ended, such as `head` in `roadplane … --out - | head`.
///
/// Such an end is no failure.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<std::io::Error>())
        .any(|io| io.kind() == std::io::ErrorKind::BrokenPipe)
}

/// Returns an exit code and writes a message to stderr if the process has too little address space to run.
///
/// The message does not go through the log, because the log would need more address space.
#[must_use]
pub fn refuse_small_address_space() -> Option<ExitCode> {
    let limit_mib = too_small_address_space()?;
    eprintln!(
        "error: too little memory: ulimit -v allows {limit_mib} MiB, but at least 1.5 GiB are needed: raise it"
    );
    // A thread of a library did not start, because memory is lacking. The library's clean-up would wait for that thread
    // for ever, so `exec` ends the process without clean-up.
    let _only_where_it_fails = std::process::Command::new("false").exec();
    Some(ExitCode::FAILURE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_each_cause_once() {
        let cause = || std::io::Error::other("disk full");
        let named = anyhow::Error::new(cause()).context("cannot write: disk full: a.csv");
        assert_eq!(message(&named), "cannot write: disk full: a.csv");
        let unnamed = anyhow::Error::new(cause()).context("cannot write a.csv");
        assert_eq!(message(&unnamed), "cannot write a.csv: disk full");
    }
}
