//! What a command came to.

/// How a command that did not fail ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything was read and written.
    Done,
    /// Some input was damaged or lost; what could be read is written and counted.
    Damaged,
}
