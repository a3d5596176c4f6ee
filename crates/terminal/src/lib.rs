//! The parts that the binaries `roadplane` and `roadplane-lab` share at the terminal.
//!
//! Contents: `arguments.rs` (arguments of every command), `config.rs` (`--config`, `--set`), `exit.rs` (exit codes),
//! `help.rs` (grouped help, manual pages, completions), `logging.rs`, `outcome.rs`, `progress.rs`, `signals.rs`.

mod arguments;
mod config;
mod exit;
pub mod help;
mod logging;
mod outcome;
mod progress;
mod signals;

pub use arguments::{CommonArgs, LogFormat};
pub use config::ConfigArgs;
pub use exit::{exit_code, refuse_small_address_space};
pub use outcome::Outcome;
pub use progress::Bar;
