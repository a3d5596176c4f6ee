//! Simulated records with truth.

#![allow(missing_docs)]

mod combining;
mod fusing;
mod linking;
mod moving_camera;
mod records;
mod selecting;
