//! Functions that implement the commands of the program.

pub(crate) mod bench;
pub(crate) mod colours;
pub(crate) mod distance;
pub(crate) mod doctor;
pub(crate) mod join;
pub(crate) mod piece;
pub(crate) mod run;
pub(crate) mod solve_file;
pub(crate) mod stage_files;
pub(crate) mod track_file;
