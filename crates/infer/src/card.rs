//! The model card: a JSON file that describes a net's inputs, outputs and ONNX file.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde_json::{Map, Value};

use crate::error::{InferError, Refusal};

/// Schema id of the cards that this code reads.
pub const CARD_SCHEMA: &str = "roadplane.model-card/1";

/// Largest size of a card file, bytes.
const MAX_CARD_BYTES: u64 = 1 << 20;

/// One dimension of a tensor: a number, or a name for a size that the caller chooses.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum Dim {
    /// A constant size.
    Fixed(usize),
    /// A size that the caller chooses. Dimensions with the same name must have the same size.
    Named(String),
}

/// Prints a dimension in the notation of the card.
impl std::fmt::Debug for Dim {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Fixed(number) => write!(f, "{number}"),
            Self::Named(name) => f.write_str(name),
        }
    }
}

/// One input or output of a net.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct TensorSpec {
    /// Name of the input or output in the ONNX graph.
    pub name: String,
    /// Type of the numbers. Only `f32` is supported.
    pub dtype: String,
    /// Dimensions of the tensor.
    pub shape: Vec<Dim>,
}

/// A variant of a net in another precision. It is a separate file with the same inputs and outputs.
#[derive(Clone, Debug, Deserialize)]
pub struct Variant {
    /// Precision of the computation, such as `int8`.
    pub precision: String,
    /// Name of the ONNX file, which lies in the card's folder.
    pub file: String,
    /// sha256 of the ONNX file, hexadecimal.
    pub sha256: String,
    /// Calibration of the variant. If absent, the calibration of the card is used.
    pub calibration: Option<Map<String, Value>>,
    /// All other entries of the variant in the card.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A model card (`models/<net>.card.json`).
#[derive(Clone, Debug, Deserialize)]
pub struct ModelCard {
    /// Schema id, which must be [`CARD_SCHEMA`].
    pub schema: String,
    /// Name of the net.
    pub name: String,
    /// Version of the net: a text or a number.
    pub version: Value,
    /// Name of the ONNX file, which lies in the card's folder.
    pub file: String,
    /// sha256 of the ONNX file, hexadecimal.
    pub sha256: String,
    /// Licence of the weights.
    pub licence: String,
    /// Inputs of the net.
    pub inputs: Vec<TensorSpec>,
    /// Outputs of the net.
    pub outputs: Vec<TensorSpec>,
    /// Parameters for the preparation of input pictures.
    #[serde(default)]
    pub preprocess: Map<String, Value>,
    /// Numbers that convert outputs to measurements. They are determined after the training.
    #[serde(default)]
    pub calibration: Map<String, Value>,
    /// Variants of the net in other precisions.
    #[serde(default)]
    pub variants: Vec<Variant>,
    /// All other entries of the card.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl ModelCard {
    /// Reads and checks a card.
    ///
    /// # Errors
    /// Returns [`InferError::ModelRefused`] with the reason.
    pub fn read(path: &Path) -> Result<Self, InferError> {
        Self::read_checked(path)
            .map_err(|reason| InferError::ModelRefused { reason, path: path.to_path_buf() })
    }

    fn read_checked(path: &Path) -> Result<Self, Refusal> {
        let bytes = read_limited(path, MAX_CARD_BYTES)?;
        let card: Self = serde_json::from_slice(&bytes)?;
        card.check()?;
        Ok(card)
    }

    fn check(&self) -> Result<(), Refusal> {
        let fail = |what: String| Err(Refusal::UnsuitableCard(what));
        if self.schema != CARD_SCHEMA {
            return fail(format!("schema is {:?}, expected {CARD_SCHEMA:?}", self.schema));
        }
        let variants = self.variants.iter().map(|variant| (&variant.file, &variant.sha256));
        for (file, sha256) in std::iter::once((&self.file, &self.sha256)).chain(variants) {
            if file.is_empty() || file.contains(['/', '\\']) || file.starts_with('.') {
                return fail(format!("file {file:?} must be a plain name beside the card"));
            }
            if sha256.len() != 64 || !sha256.bytes().all(|b| b.is_ascii_hexdigit()) {
                return fail(format!("sha256 of {file} must be 64 hexadecimal digits"));
            }
        }
        if self.inputs.is_empty() || self.outputs.is_empty() {
            return fail("a net has at least one input and one output".to_owned());
        }
        for spec in self.inputs.iter().chain(&self.outputs) {
            if spec.dtype != "f32" {
                return fail(format!("{} is of type {:?}; only f32 is known", spec.name, spec.dtype));
            }
            if spec.shape.contains(&Dim::Fixed(0)) {
                return fail(format!("{} has an empty dimension", spec.name));
            }
        }
        Ok(())
    }

    /// Returns the card of this net in another precision, or `None` if there is no such variant.
    ///
    /// The file, the hash and the calibration are those of the variant.
    #[must_use]
    pub fn in_precision(&self, precision: &str) -> Option<Self> {
        let variant = self.variants.iter().find(|variant| variant.precision == precision)?;
        let mut card = self.clone();
        card.file.clone_from(&variant.file);
        card.sha256.clone_from(&variant.sha256);
        if let Some(calibration) = &variant.calibration {
            card.calibration.clone_from(calibration);
        }
        Some(card)
    }

    /// Returns the version as text.
    #[must_use]
    pub fn version_text(&self) -> String {
        self.version.as_str().map_or_else(|| self.version.to_string(), str::to_owned)
    }

    /// Returns the output with this name, if there is one.
    #[must_use]
    pub fn output(&self, name: &str) -> Option<&TensorSpec> {
        self.outputs.iter().find(|spec| spec.name == name)
    }

    /// Returns the input with this name, if there is one.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&TensorSpec> {
        self.inputs.iter().find(|spec| spec.name == name)
    }
}

impl TensorSpec {
    /// Whether the shape of a tensor agrees with the card. `named` collects the sizes of the named dimensions. The same
    /// name must have the same size in all tensors.
    pub(crate) fn fits<'a>(&'a self, shape: &[usize], named: &mut BTreeMap<&'a str, usize>) -> bool {
        shape.len() == self.shape.len()
            && self.shape.iter().zip(shape).all(|(dim, &size)| match dim {
                Dim::Fixed(fixed) => *fixed == size,
                Dim::Named(name) => *named.entry(name.as_str()).or_insert(size) == size,
            })
    }

    /// Whether the dimensions that a graph declares agree with the card. A negative dimension is dynamic.
    ///
    /// A fixed dimension of the card may be dynamic in the graph, because programs that export ONNX files may lose
    /// sizes. A named dimension of the card must be dynamic in the graph.
    pub(crate) fn is_served_by(&self, declared: &[i64]) -> bool {
        declared.len() == self.shape.len()
            && self.shape.iter().zip(declared).all(|(dim, &size)| match dim {
                Dim::Fixed(fixed) => size < 0 || usize::try_from(size) == Ok(*fixed),
                Dim::Named(_) => size < 0,
            })
    }
}

/// Reads a whole file. A file with more than `limit` bytes is refused.
pub(crate) fn read_limited(path: &Path, limit: u64) -> Result<Vec<u8>, Refusal> {
    use std::io::Read as _;

    let file = std::fs::File::open(path)?;
    let mut bytes = Vec::new();
    // One byte more than the limit is read. So a file that is too large is detected even if its metadata are wrong.
    file.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(Refusal::TooLarge { bytes: bytes.len() as u64, limit });
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(shape: &str) -> TensorSpec {
        serde_json::from_str(&format!(r#"{{"name": "x", "dtype": "f32", "shape": {shape}}}"#)).unwrap()
    }

    #[test]
    fn named_dimensions_must_agree() {
        let (a, b) = (spec(r#"["batch", 3, "size", "size"]"#), spec(r#"["batch", 2]"#));
        let mut named = BTreeMap::new();
        assert!(a.fits(&[4, 3, 128, 128], &mut named) && b.fits(&[4, 2], &mut named));
        assert!(!b.fits(&[5, 2], &mut named));
        assert!(!a.fits(&[1, 3, 128, 64], &mut BTreeMap::new()));
        assert!(!a.fits(&[1, 3, 128], &mut BTreeMap::new()));
    }

    #[test]
    fn a_graph_may_be_freer_than_its_card_but_not_stricter() {
        let card = spec(r#"["batch", 3]"#);
        assert!(card.is_served_by(&[-1, 3]) && card.is_served_by(&[-1, -1]));
        assert!(!card.is_served_by(&[1, 3]) && !card.is_served_by(&[-1, 4]) && !card.is_served_by(&[-1]));
    }
}
