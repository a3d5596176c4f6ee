//! The outcome of a command, from which the exit code follows.

/// The outcome of a command that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything was read and written.
    Done,
    /// Some input was damaged, lost or only partly followed. Results were written for all other parts.
    Damaged,
}
