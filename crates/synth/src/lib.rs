//! roadplane: synth.
