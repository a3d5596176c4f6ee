//! Estimates the camera of a clip: windows of views, joint solves, user constraints and the camera database.
//!
//! The result is one estimate per interval with a constant camera.

pub(crate) mod camera_track;
pub(crate) mod database;
pub(crate) mod empty_scene_view;
pub(crate) mod estimate;
pub(crate) mod frame;
pub(crate) mod joining;
pub(crate) mod known;
pub(crate) mod krtd;
pub(crate) mod lens;
pub(crate) mod optics;
mod second_plane;
mod stored;
mod window;
