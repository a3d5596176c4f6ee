//! Runs neural nets with ONNX Runtime. A [`Session`] is a net that is loaded from its model card and its ONNX file.
//!
//! Every model is checked. Its sha256 is compared with the sha256 in the card before the runtime reads the model.
//! Models that refer to data outside their file are refused. Names, types and shapes of inputs and outputs must agree
//! with the card. An output with NaN or infinite numbers is an error.
//!
//! A card may also name an int8 file of its net ([`Variant`]). A [`Provider`] is the part of the runtime that computes
//! the net. [`ProviderChoice::Auto`] chooses the fastest provider for this processor that keeps the net's accuracy. The
//! choice is logged once.
//!
//! # Contents
//! - `card.rs`: inputs, outputs and file of a net
//! - `external_data.rs`: finds models with data outside their file
//! - `session.rs`: a loaded net
//! - `runtime.rs`, `processor.rs`: the choice of the provider

mod card;
mod error;
mod external_data;
mod processor;
mod runtime;
mod session;

pub use card::{CARD_SCHEMA, Dim, ModelCard, TensorSpec, Variant};
pub use error::{InferError, Refusal};
pub use processor::Processor;
pub use runtime::{
    Provider, ProviderChoice, RUNTIME_LIBRARY, find_library, python_packages, runtime_version,
};
pub use session::{NamedTensor, Outputs, Session, SessionOptions};
