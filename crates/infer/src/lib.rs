//! Runs every net through one session type: a model card, its ONNX file, ONNX Runtime.
//!
//! Nothing reaches the runtime unchecked. The file's sha256 is compared with the card's before the runtime reads a
//! byte. Models that refer to data outside their file are refused. Names, types and shapes of inputs and outputs must
//! equal the card's. Outputs with NaN or infinite numbers are an error, never a result.
//!
//! A card may also name an int8 file of its net ([`Variant`]). [`ProviderChoice::Auto`] chooses the fastest provider on
//! this processor that keeps the net's accuracy, and logs the choice once.
//!
//! # Contents
//! - `card.rs`: inputs, outputs and file of a net
//! - `external_data.rs`: models that are refused
//! - `session.rs`: a loaded net
//! - `runtime.rs`, `processor.rs`: the provider that computes it

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
