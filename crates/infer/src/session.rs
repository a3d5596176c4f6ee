//! Loads a net and runs it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ndarray::{ArrayD, ArrayViewD, CowArray};
use ort::environment::Environment;
use ort::session::Session as OrtSession;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::value::{Outlet, TensorElementType, TensorRef, TensorValueType, Value, ValueType};
use rustix::time::{ClockId, clock_gettime};
use sha2::{Digest as _, Sha256};
use thiserror::Error;

use crate::card::{ModelCard, TensorSpec, read_limited};
use crate::error::{InferError, Refusal};
use crate::external_data::refuse_external_data;
use crate::runtime::{OPENVINO_NAME, Provider, ProviderChoice, openvino_cpu, prepare};

/// Name of the runtime's own execution provider.
const CPU_NAME: &str = "CPUExecutionProvider";
/// Largest size of a model file, bytes.
const MAX_MODEL_BYTES: u64 = 512 << 20;

/// Options for opening a session.
#[derive(Clone, Debug)]
pub struct SessionOptions {
    /// The requested provider.
    pub provider: ProviderChoice,
    /// Number of threads that one run of the net uses. Several sessions with one thread each are faster than one
    /// session with several threads.
    pub threads: usize,
    /// Path of the library of ONNX Runtime. If `None`, [`crate::find_library`] searches for it.
    pub library: Option<PathBuf>,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self { provider: ProviderChoice::Auto, threads: 1, library: None }
    }
}

/// An input tensor of a net.
#[derive(Clone, Debug)]
pub struct NamedTensor<'a> {
    /// Name of the input.
    pub name: &'a str,
    /// Values of the input. They are copied only if they are not contiguous.
    pub values: ArrayViewD<'a, f32>,
}

/// The outputs of one run of a net, by name. The runtime owns their memory and frees it when this object is dropped.
#[derive(Debug)]
pub struct Outputs(Vec<(Arc<str>, Value<TensorValueType<f32>>)>);

impl Outputs {
    /// Copies an output. Returns `None` if the card has no output with this name.
    #[must_use]
    pub fn take(&self, name: &str) -> Option<ArrayD<f32>> {
        self.get(name).map(|view| view.to_owned())
    }

    /// Borrows an output. Returns `None` if the card has no output with this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<ArrayViewD<'_, f32>> {
        self.0.iter().find(|(of, _)| &**of == name).map(|(_, value)| value.extract_array())
    }
}

/// A net that was checked against its card and is ready to run.
#[derive(Debug)]
pub struct Session {
    inner: OrtSession,
    card: ModelCard,
    output_names: Vec<Arc<str>>,
    provider: Provider,
    net_s: f64,
}

impl Session {
    /// Opens the net whose card is at `card_path`.
    ///
    /// # Errors
    /// Returns [`InferError::ModelRefused`] if the card or the model fails a check. Returns
    /// [`InferError::RuntimeMissing`] or [`InferError::ProviderUnavailable`] if the net cannot run on this machine.
    pub fn open(card_path: &Path, options: &SessionOptions) -> Result<Self, InferError> {
        let card = ModelCard::read(card_path)?;
        let (environment, wanted) = prepare(options.library.as_deref(), options.provider)?;
        let (card, mut provider) = chosen_file(card, card_path, wanted, options.provider)?;
        let path = card_path.with_file_name(&card.file);
        let refused = |reason| InferError::ModelRefused { reason, path: path.clone() };
        let bytes = verified_bytes(&card, &path).map_err(refused)?;
        let mut committed = commit(&environment, &bytes, provider, options.threads);
        if let (Err(error), ProviderChoice::Auto, Provider::OpenvinoBf16) =
            (&committed, options.provider, provider)
        {
            tracing::warn!("OpenVINO refuses {}, using the CPU provider: {error}", card.name);
            provider = Provider::Cpu;
            committed = commit(&environment, &bytes, provider, options.threads);
        }
        let inner = committed.map_err(|error| match error {
            CommitError::Model(what) => refused(Refusal::Rejected(what)),
            CommitError::Provider(what) => InferError::ProviderUnavailable { provider: "openvino", what },
        })?;
        check_interface("input", &card.inputs, inner.inputs()).map_err(refused)?;
        check_interface("output", &card.outputs, inner.outputs()).map_err(refused)?;
        tracing::debug!(net = card.name, version = card.version_text(), file = card.file, %provider, "net loaded");
        let output_names = card.outputs.iter().map(|spec| Arc::from(spec.name.as_str())).collect();
        Ok(Self { inner, card, output_names, provider, net_s: 0.0 })
    }

    /// Returns the card of the net. Its file, hash and calibration are those of the variant in use.
    #[must_use]
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// Returns the provider in use.
    #[must_use]
    pub fn provider(&self) -> Provider {
        self.provider
    }

    /// Returns the processor time that the calling threads have spent inside the runtime, s.
    ///
    /// If the session has one thread, this is the processor time of the whole net.
    #[must_use]
    pub fn net_s(&self) -> f64 {
        self.net_s
    }

    /// Runs the net once.
    ///
    /// # Errors
    /// Returns [`InferError::WrongInput`] if the tensors do not agree with the card. Returns [`InferError::NonFinite`]
    /// if the net returns NaN or infinite numbers. Returns [`InferError::Failed`] if the runtime fails.
    pub fn run(&mut self, inputs: &[NamedTensor<'_>]) -> Result<Outputs, InferError> {
        let Self { inner, card, output_names, net_s, .. } = self;
        let wrong = |what: String| InferError::WrongInput { model: card.name.clone(), what };
        let failed = |what: String| InferError::Failed { model: card.name.clone(), what };
        let mut named = BTreeMap::new();
        let mut contiguous: Vec<(&str, CowArray<'_, f32, ndarray::IxDyn>)> = Vec::new();
        for spec in &card.inputs {
            let tensor = inputs
                .iter()
                .find(|tensor| tensor.name == spec.name)
                .ok_or_else(|| wrong(format!("{} is missing", spec.name)))?;
            if !spec.fits(tensor.values.shape(), &mut named) || tensor.values.is_empty() {
                let (found, expected) = (tensor.values.shape(), &spec.shape);
                return Err(wrong(format!("{} has shape {found:?}, expected {expected:?}", spec.name)));
            }
            contiguous.push((spec.name.as_str(), tensor.values.as_standard_layout()));
        }
        if inputs.len() != card.inputs.len() {
            return Err(wrong(format!("{} tensors for {} inputs", inputs.len(), card.inputs.len())));
        }
        let mut values = Vec::new();
        for (name, array) in &contiguous {
            let value = TensorRef::from_array_view(array.view()).map_err(|e| failed(e.to_string()))?;
            values.push((*name, value));
        }
        let started = thread_cpu_s();
        let ran = inner.run(values);
        *net_s += thread_cpu_s() - started;
        let mut results = ran.map_err(|e| failed(e.to_string()))?;
        let mut outputs = Vec::with_capacity(card.outputs.len());
        for (spec, name) in card.outputs.iter().zip(output_names.iter()) {
            let value =
                results.remove(&spec.name).ok_or_else(|| failed(format!("no output {}", spec.name)))?;
            let value = value.downcast::<TensorValueType<f32>>().map_err(|e| failed(e.to_string()))?;
            let (shape, numbers) = value.extract_tensor();
            let shape: Vec<usize> = shape.iter().filter_map(|&size| usize::try_from(size).ok()).collect();
            if !spec.fits(&shape, &mut named) {
                let expected = &spec.shape;
                return Err(failed(format!("{} has shape {shape:?}, expected {expected:?}", spec.name)));
            }
            let count = not_finite(numbers);
            if count > 0 {
                let (model, output) = (card.name.clone(), spec.name.clone());
                return Err(InferError::NonFinite { model, output, count });
            }
            outputs.push((Arc::clone(name), value));
        }
        Ok(Outputs(outputs))
    }
}

/// Returns the processor time of the calling thread so far, s.
fn thread_cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Counts the numbers that are NaN or infinite.
///
/// The function tests the bits of the numbers in blocks. Compilers turn such a loop into vector instructions.
fn not_finite(numbers: &[f32]) -> usize {
    const EXPONENT: u32 = 0x7f80_0000;
    let in_block = |block: &[f32]| -> u32 {
        block.iter().map(|number| u32::from(number.to_bits() & EXPONENT == EXPONENT)).sum()
    };
    numbers.chunks(1 << 16).map(|block| in_block(block) as usize).sum()
}

/// Returns the card of the file that the wanted provider needs, and the provider.
///
/// If there is no int8 file, [`ProviderChoice::Auto`] falls back to f32.
fn chosen_file(
    card: ModelCard,
    card_path: &Path,
    wanted: Provider,
    choice: ProviderChoice,
) -> Result<(ModelCard, Provider), InferError> {
    if wanted != Provider::Int8 {
        return Ok((card, wanted));
    }
    let what = match card.in_precision("int8") {
        None => format!("the card of {} names no int8 file", card.name),
        Some(variant)
            if choice == ProviderChoice::Auto && !card_path.with_file_name(&variant.file).exists() =>
        {
            format!("{} is missing", variant.file)
        }
        Some(variant) => return Ok((variant, wanted)),
    };
    if choice != ProviderChoice::Auto {
        return Err(InferError::ProviderUnavailable { provider: "int8", what });
    }
    tracing::warn!("int8 would be faster on this CPU, but {what}; {} runs in f32", card.name);
    Ok((card, Provider::Cpu))
}

/// Reads a model file. Checks its sha256, and that no data of the model lie outside the file.
fn verified_bytes(card: &ModelCard, path: &Path) -> Result<Vec<u8>, Refusal> {
    let bytes = read_limited(path, MAX_MODEL_BYTES)?;
    let found: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    if !found.eq_ignore_ascii_case(&card.sha256) {
        return Err(Refusal::WrongHash { expected: card.sha256.clone(), found });
    }
    refuse_external_data(&bytes)?;
    Ok(bytes)
}

#[derive(Debug, Error)]
enum CommitError {
    #[error("{0}")]
    Model(String),
    #[error("{0}")]
    Provider(String),
}

fn commit(
    environment: &Environment,
    bytes: &[u8],
    provider: Provider,
    threads: usize,
) -> Result<OrtSession, CommitError> {
    let model = |error: &dyn std::fmt::Display| CommitError::Model(error.to_string());
    let builder = OrtSession::builder(environment)
        .map_err(|e| model(&e))?
        .with_intra_threads(threads.max(1))
        .map_err(|e| model(&e))?
        // A spinning thread would occupy the core that other stages need.
        .with_intra_op_spinning(false)
        .map_err(|e| model(&e))?
        .with_deterministic_compute(true)
        .map_err(|e| model(&e))?
        .with_optimization_level(GraphOptimizationLevel::Level3)
        .map_err(|e| model(&e))?;
    match provider {
        Provider::Cpu | Provider::Int8 => {
            let mut builder = builder;
            // Without an explicit device, sessions give work to every provider that the process has registered.
            if let Some(device) =
                environment.devices().find(|device| device.ep().is_ok_and(|ep| ep == CPU_NAME))
            {
                builder = builder.with_devices([device], None).map_err(|e| model(&e))?;
            }
            builder.commit_from_memory(bytes).map_err(|e| model(&e))
        }
        Provider::OpenvinoBf16 => {
            let config = format!(
                r#"{{"CPU":{{"INFERENCE_PRECISION_HINT":"bf16","INFERENCE_NUM_THREADS":"{}"}}}}"#,
                threads.max(1)
            );
            let mut builder = with_openvino(builder, environment, config).map_err(CommitError::Provider)?;
            builder.commit_from_memory(bytes).map_err(|e| model(&e))
        }
    }
}

fn with_openvino(
    builder: SessionBuilder,
    environment: &Environment,
    config: String,
) -> Result<SessionBuilder, String> {
    let device = openvino_cpu(environment).ok_or("the plug-in offers no CPU device")?;
    let options = [(format!("{OPENVINO_NAME}.load_config"), config)];
    builder.with_devices([device], Some(&options)).map_err(|e| e.to_string())
}

/// Checks that the inputs or outputs that the graph declares agree with the card.
fn check_interface(kind: &str, specs: &[TensorSpec], outlets: &[Outlet]) -> Result<(), Refusal> {
    let fail = |what: String| Err(Refusal::Interface(what));
    let found: Vec<&str> = outlets.iter().map(Outlet::name).collect();
    if specs.len() != outlets.len() {
        return fail(format!("the model has {kind}s {found:?}, the card describes {}", specs.len()));
    }
    for spec in specs {
        let Some(outlet) = outlets.iter().find(|outlet| outlet.name() == spec.name) else {
            return fail(format!("the model has {kind}s {found:?}, the card says {:?}", spec.name));
        };
        let ValueType::Tensor { ty: TensorElementType::Float32, shape, .. } = outlet.dtype() else {
            return fail(format!("{kind} {} is not a tensor of f32", spec.name));
        };
        if !spec.is_served_by(shape) {
            let declared: &[i64] = shape;
            return fail(format!(
                "{kind} {} has shape {declared:?}, the card says {:?}",
                spec.name, spec.shape
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_that_is_not_finite_counts() {
        let mut numbers = vec![1.0_f32; 200_000];
        assert_eq!(not_finite(&numbers), 0);
        for (at, value) in [(0, f32::NAN), (65_536, f32::INFINITY), (199_999, f32::NEG_INFINITY)] {
            numbers[at] = value;
        }
        numbers[5] = f32::MAX;
        numbers[6] = f32::MIN_POSITIVE / 2.0;
        assert_eq!(not_finite(&numbers), 3);
        assert_eq!(not_finite(&[]), 0);
    }
}
