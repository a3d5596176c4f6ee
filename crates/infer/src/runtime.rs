//! Finding and loading ONNX Runtime, and choosing how it computes.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use ort::device::Device;
use ort::environment::Environment;
use ort::logging::LogLevel;
use ort::memory::DeviceType;
use serde::{Deserialize, Serialize};

use crate::error::InferError;

/// Where `scripts/setup` puts the library, from the top of the checkout.
pub const RUNTIME_LIBRARY: &str = ".runtime/libonnxruntime.so";

const OPENVINO_FOLDER: &str = "openvino";
const OPENVINO_LIBRARY: &str = "libonnxruntime_providers_openvino_plugin.so";
pub(crate) const OPENVINO_NAME: &str = "OpenVINOExecutionProvider";

/// What the configuration asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProviderChoice {
    /// OpenVINO in bf16 where the CPU has bf16 instructions and the plug-in is there, else the CPU provider.
    #[default]
    Auto,
    /// The runtime's own CPU provider, f32.
    Cpu,
    /// The OpenVINO plug-in in bf16, or an error.
    Openvino,
}

/// What computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Provider {
    /// The runtime's own CPU provider, f32.
    Cpu,
    /// The OpenVINO plug-in with bf16 allowed (f32 where the CPU lacks it).
    OpenvinoBf16,
}

impl fmt::Display for Provider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cpu => "CPU f32",
            Self::OpenvinoBf16 => "OpenVINO bf16",
        })
    }
}

/// The runtime of this process; one only, the library cannot be exchanged once loaded.
struct Runtime {
    environment: Environment,
    library: PathBuf,
    openvino_registered: bool,
}

static RUNTIME: Mutex<Option<Runtime>> = Mutex::new(None);

/// Whether the CPU multiplies bf16 numbers natively (AMX or AVX-512): only there OpenVINO in bf16 pays.
#[must_use]
pub fn cpu_has_bf16() -> bool {
    std::fs::read_to_string("/proc/cpuinfo").is_ok_and(|text| {
        text.lines()
            .find(|line| line.starts_with("flags"))
            .is_some_and(|line| line.split_whitespace().any(|f| f == "amx_bf16" || f == "avx512_bf16"))
    })
}

/// The runtime's library: `explicit`, else `ORT_DYLIB_PATH`, else [`RUNTIME_LIBRARY`] in a folder above the
/// executable, else above the current folder.
///
/// # Errors
/// [`InferError::RuntimeMissing`] naming what was tried.
pub fn find_library(explicit: Option<&Path>) -> Result<PathBuf, InferError> {
    if let Some(path) = explicit {
        return existing(path, "the configured library");
    }
    if let Some(path) = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()) {
        return existing(Path::new(&path), "ORT_DYLIB_PATH");
    }
    let starts = [std::env::current_exe(), std::env::current_dir()];
    starts
        .iter()
        .flatten()
        .flat_map(|start| start.ancestors())
        .map(|folder| folder.join(RUNTIME_LIBRARY))
        .find(|path| path.is_file())
        .ok_or_else(|| InferError::RuntimeMissing {
            what: format!("no {RUNTIME_LIBRARY} above the executable or the current folder"),
        })
}

fn existing(path: &Path, origin: &str) -> Result<PathBuf, InferError> {
    // Absolute, because a bare name would be looked up in the system's library folders.
    match path.canonicalize() {
        Ok(path) if path.is_file() => Ok(path),
        Ok(_) => Err(InferError::RuntimeMissing { what: format!("{origin} is no file: {}", path.display()) }),
        Err(error) => Err(InferError::RuntimeMissing {
            what: format!("{origin} cannot be used: {error}: {}", path.display()),
        }),
    }
}

/// Version and build of the loaded runtime; loads it if need be.
///
/// # Errors
/// [`InferError::RuntimeMissing`].
pub fn runtime_version(explicit: Option<&Path>) -> Result<String, InferError> {
    with_runtime(explicit, |runtime| Ok(format!("{} ({})", ort::info(), runtime.library.display())))
}

fn with_runtime<T>(
    explicit: Option<&Path>,
    work: impl FnOnce(&mut Runtime) -> Result<T, InferError>,
) -> Result<T, InferError> {
    let library = find_library(explicit)?;
    let mut slot = RUNTIME.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(runtime) = slot.as_mut() {
        return work(runtime);
    }
    let missing = |what: String| InferError::RuntimeMissing { what };
    let environment = ort::init_from(&library)
        .map_err(|e| missing(e.to_string()))?
        .with_name("roadplane")
        .with_telemetry(false)
        .with_logger(Arc::new(log))
        .build()
        .map_err(|e| missing(e.to_string()))?;
    environment.set_log_level(LogLevel::Warning);
    work(slot.insert(Runtime { environment, library, openvino_registered: false }))
}

/// The runtime's messages go where ours go. Its warnings are about graph details: not for users.
fn log(level: LogLevel, category: &str, _id: &str, _location: &str, message: &str) {
    match level {
        LogLevel::Error | LogLevel::Fatal => tracing::error!(category, "onnxruntime: {message}"),
        _ => tracing::debug!(category, "onnxruntime: {message}"),
    }
}

/// The environment to open sessions in and the provider to open them with.
pub(crate) fn prepare(
    explicit: Option<&Path>,
    choice: ProviderChoice,
) -> Result<(Environment, Provider), InferError> {
    with_runtime(explicit, |runtime| {
        let provider = match choice {
            ProviderChoice::Cpu => Provider::Cpu,
            ProviderChoice::Openvino => {
                register_openvino(runtime)
                    .map_err(|what| InferError::ProviderUnavailable { provider: "openvino", what })?;
                Provider::OpenvinoBf16
            }
            ProviderChoice::Auto if !cpu_has_bf16() => Provider::Cpu,
            ProviderChoice::Auto => match register_openvino(runtime) {
                Ok(()) => Provider::OpenvinoBf16,
                Err(what) => {
                    tracing::warn!(
                        "OpenVINO would be faster on this CPU, but {what}; using the CPU provider"
                    );
                    Provider::Cpu
                }
            },
        };
        Ok((runtime.environment.clone(), provider))
    })
}

fn register_openvino(runtime: &mut Runtime) -> Result<(), String> {
    let plugin = runtime
        .library
        .parent()
        .map(|folder| folder.join(OPENVINO_FOLDER).join(OPENVINO_LIBRARY))
        .filter(|path| path.is_file())
        .ok_or_else(|| "the plug-in is not beside the runtime (scripts/setup --with-openvino)".to_owned())?;
    if !runtime.openvino_registered {
        runtime
            .environment
            .register_ep_library(OPENVINO_NAME, &plugin)
            .map_err(|error| format!("the plug-in cannot be loaded: {error}"))?;
        runtime.openvino_registered = true;
    }
    // On other makers' processors the plug-in loads but offers nothing.
    openvino_cpu(&runtime.environment)
        .map(|_| ())
        .ok_or_else(|| "the plug-in offers no CPU device".to_owned())
}

/// The plug-in's CPU device.
pub(crate) fn openvino_cpu(environment: &Environment) -> Option<Device<'_>> {
    environment.devices().find(|device| {
        device.ep().is_ok_and(|ep| ep == OPENVINO_NAME) && device.hardware_device().ty() == DeviceType::CPU
    })
}
