//! Video files, single images and folders of images, as frames with their presentation times.
//!
//! A file is recognised by its content before any codec sees it. Damage does not stop a clip: what can be decoded is
//! handed on, what is lost is counted in a [`DecodeReport`]. OpenCV tells of no loss, so it is found by other signs:
//! frames that the container promises or holds and the decoder does not give, gaps in a steady stream's times, slices
//! that contradict themselves, a file shorter than its own structure. What stays unseen is damage inside a packet whose
//! headers are sound, which FFmpeg conceals in the picture.
//!
//! # Contents
//! - the way in: [`open`] (`input.rs`), by content (`sniff.rs`), a kind each: `video.rs`, `still.rs`, `folder.rs`
//! - what was lost: `packets.rs`, `structure.rs`, `clock.rs` → [`DecodeReport`]
//!
//! # Example
//! ```no_run
//! use roadplane_decode::{DecodeOptions, open};
//!
//! let mut input = open("lot.mp4".as_ref(), &DecodeOptions::default())?;
//! while let Some(frame) = input.next_frame()? {
//!     println!("{:.2} s, {} wide", frame.stamp.time_s(), frame.size().width);
//! }
//! println!("{} frames lost", input.report().missing);
//! # Ok::<(), roadplane_decode::DecodeError>(())
//! ```

mod clock;
mod decoded;
mod error;
mod folder;
mod input;
mod library;
mod options;
mod packets;
mod report;
mod sniff;
mod still;
mod structure;
mod video;

pub use decoded::Decoded;
pub use error::DecodeError;
pub use input::{Input, InputKind, open, open_part};
pub use library::{backends, library_version};
pub use options::DecodeOptions;
pub use report::{DecodeReport, Stretch};
pub use sniff::{Content, sniff};
