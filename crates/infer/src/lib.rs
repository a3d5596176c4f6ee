//! One session type for every net: a model card, its ONNX file, ONNX Runtime.
//!
//! Nothing reaches the runtime unchecked: the file's sha256 is compared with the card's before the runtime sees a
//! byte, models that point at data outside their file are refused, and names, types and shapes of inputs and
//! outputs must be the card's. Outputs with NaN or infinite numbers are an error, never a result.

mod card;
mod error;
mod external_data;
mod runtime;
mod session;

pub use card::{CARD_SCHEMA, Dim, ModelCard, TensorSpec};
pub use error::{InferError, Refusal};
pub use runtime::{Provider, ProviderChoice, RUNTIME_LIBRARY, cpu_has_bf16, find_library, runtime_version};
pub use session::{NamedTensor, Outputs, Session, SessionOptions};
