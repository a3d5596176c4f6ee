//! Perception: reads the frames of an input and writes one JSON line per frame. Each stage has its own thread.

pub(crate) mod backgrounds;
pub(crate) mod cadence;
pub(crate) mod cpu;
pub(crate) mod flow;
pub(crate) mod moments;
pub(crate) mod nets;
pub(crate) mod perception;
pub(crate) mod samples;
pub(crate) mod scene_lines;
pub(crate) mod small_picture;
pub(crate) mod span;
pub(crate) mod speed;
pub(crate) mod stages;
pub(crate) mod stills;
pub(crate) mod streaming;
pub(crate) mod watched;
