//! One file per command. Each command calls the crate `pipeline` with its arguments and prints the outcome.

pub mod cameras;
pub mod copy;
pub mod distance;
pub mod doctor;
pub mod export;
pub mod lab;
pub mod pieces;
pub mod render;
pub mod run;
pub mod schemas;
pub mod site;
pub mod stages;
