//! One session type for every net: a model card, its ONNX file, ONNX Runtime.
//!
//! Nothing reaches the runtime unchecked: the file's sha256 is compared with the card's before the runtime sees a
//! byte, models that point at data outside their file are refused, and names, types and shapes of inputs and
//! outputs must be the card's. Outputs with NaN or infinite numbers are an error, never a result.
//!
//! A card may name its net in int8 as well ([`Variant`]). [`ProviderChoice::Auto`] takes what is fastest on the processor
//! at hand among what keeps the net's accuracy, and says once in the log what that is.
//!
//! # Contents
//! `card.rs` what a net takes and gives; `external_data.rs` what is refused; `session.rs` a loaded net; `runtime.rs`, `processor.rs`
//! how it is computed.

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
