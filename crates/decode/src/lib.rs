//! Decodes video files, single images and folders of images into frames with their presentation times.
//!
//! The kind of a file is recognised by its content before any codec opens it. Damage does not stop a clip: every frame
//! that can be decoded is delivered, and lost frames are counted in a [`DecodeReport`].
//!
//! OpenCV does not report lost frames, so this crate looks for other signs of a loss:
//! - frames that the container promises and the decoder does not return
//! - gaps between the times of frames in a stream with a steady rate
//! - H.264 slices whose headers contradict themselves
//! - a file that is shorter than its own structure states
//!
//! Damage inside a packet with valid headers is not detected, because FFmpeg conceals it in the picture.
//!
//! # Contents
//! - opening an input: [`open`] (`input.rs`); recognising its kind by its content (`sniff.rs`); refusing addresses
//!   (`address.rs`)
//! - reading each kind: `video.rs`, `still.rs`, `folder.rs`
//! - finding lost frames for the [`DecodeReport`]: `packets.rs`, `structure.rs`, `clock.rs`
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

mod address;
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

pub use address::refuse_address;
pub use decoded::Decoded;
pub use error::DecodeError;
pub use folder::FolderContent;
pub use input::{Input, InputKind, open, open_part};
pub use library::{backends, library_version};
pub use options::{ASSUMED_IMAGE_FPS, DecodeOptions};
pub use report::{DamagedInterval, DecodeReport};
pub use sniff::{Content, sniff};
pub use structure::creation_time;
