//! Finds and loads ONNX Runtime, and chooses the execution provider.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use ort::device::Device;
use ort::environment::Environment;
use ort::logging::LogLevel;
use ort::memory::DeviceType;
use rustix::process::{Resource, getrlimit};
use serde::{Deserialize, Serialize};

use crate::error::InferError;
use crate::processor::Processor;

/// Path of the ONNX Runtime library that `scripts/setup` installs, relative to the root of the repository.
pub const RUNTIME_LIBRARY: &str = ".runtime/libonnxruntime.so";

/// Folder of the OpenVINO plug-in, inside the folder of the runtime's library.
const OPENVINO_FOLDER: &str = "openvino";
/// File name of the OpenVINO plug-in.
const OPENVINO_LIBRARY: &str = "libonnxruntime_providers_openvino_plugin.so";
/// Address space that a run with OpenVINO requires, bytes. Measured values at 720p are 2 GiB with OpenVINO and 1 GiB
/// without it.
const OPENVINO_SPACE: u64 = 3 << 30;
/// Name of the OpenVINO execution provider in the runtime.
pub(crate) const OPENVINO_NAME: &str = "OpenVINOExecutionProvider";

/// The execution provider that the configuration requests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProviderChoice {
    /// The fastest provider on this machine that keeps the accuracy.
    ///
    /// It is OpenVINO in bf16 if the CPU has AMX and the plug-in is installed. Otherwise it is the CPU provider: in
    /// int8 if the CPU has VNNI, and in f32 if not.
    #[default]
    Auto,
    /// The runtime's own CPU provider, in f32.
    Cpu,
    /// The runtime's own CPU provider with the nets' int8 files. If a net has no int8 file, loading it is an error.
    Int8,
    /// The OpenVINO plug-in in bf16. If the plug-in cannot be used, loading a net is an error.
    Openvino,
}

/// The execution provider that a session uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Provider {
    /// The runtime's own CPU provider, in f32.
    Cpu,
    /// The runtime's own CPU provider with the net's int8 file.
    Int8,
    /// The OpenVINO plug-in in bf16. It computes in f32 if the CPU lacks bf16.
    OpenvinoBf16,
}

impl fmt::Display for Provider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cpu => "CPU f32",
            Self::Int8 => "CPU int8",
            Self::OpenvinoBf16 => "OpenVINO bf16",
        })
    }
}

/// The loaded ONNX Runtime library of this process. There is only one, because a loaded library cannot be replaced.
struct Runtime {
    environment: Environment,
    library: PathBuf,
    openvino_registered: bool,
    is_logged: bool,
}

static RUNTIME: Mutex<Option<Runtime>> = Mutex::new(None);
/// Path of the library, from the first search. It is stored because a process in a sandbox cannot search folders again.
static FOUND: OnceLock<PathBuf> = OnceLock::new();

/// Finds the library of ONNX Runtime.
///
/// The function tries these candidates in order:
/// - the path `explicit`
/// - the environment variable `ORT_DYLIB_PATH`
/// - the Python package `onnxruntime` in the folders of [`python_packages`]
/// - [`RUNTIME_LIBRARY`] in a folder above the executable or above the current folder
///
/// # Errors
/// Returns [`InferError::RuntimeMissing`] with the candidates that failed.
pub fn find_library(explicit: Option<&Path>) -> Result<PathBuf, InferError> {
    if let Some(path) = explicit {
        return existing(path, "the configured library");
    }
    if let Some(path) = std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()) {
        return existing(Path::new(&path), "ORT_DYLIB_PATH");
    }
    if let Some(path) = FOUND.get() {
        return Ok(path.clone());
    }
    let starts = [std::env::current_exe(), std::env::current_dir()];
    let packages = starts[0].iter().flat_map(|executable| python_packages(executable));
    let above = starts.iter().flatten().flat_map(|start| start.ancestors());
    packages
        .filter_map(|packages| packaged_library(&packages))
        .chain(above.map(|folder| folder.join(RUNTIME_LIBRARY)))
        .find(|path| path.is_file())
        .map(|path| FOUND.get_or_init(|| path).clone())
        .ok_or_else(|| InferError::RuntimeMissing {
            what: format!("no {RUNTIME_LIBRARY} above the executable or the current folder"),
        })
}

/// Returns the folders of Python packages that belong to an executable installed by `pip`.
///
/// For `PREFIX/bin/roadplane`, the folders are `PREFIX/lib/python3*/site-packages`. Debian's own Python names them
/// `dist-packages`.
#[must_use]
pub fn python_packages(executable: &Path) -> Vec<PathBuf> {
    let libraries = executable.parent().and_then(Path::parent).map(|prefix| prefix.join("lib"));
    let pythons = libraries.map(|folder| entries(&folder, "python3")).unwrap_or_default();
    let packages = |python: &PathBuf| ["site-packages", "dist-packages"].map(|name| python.join(name));
    pythons.iter().flat_map(packages).filter(|folder| folder.is_dir()).collect()
}

fn packaged_library(packages: &Path) -> Option<PathBuf> {
    entries(&packages.join("onnxruntime/capi"), "libonnxruntime.so").into_iter().next()
}

/// Returns the entries of a folder whose names begin with `beginning`, sorted by name.
///
/// The list is empty if the folder cannot be read.
fn entries(folder: &Path, beginning: &str) -> Vec<PathBuf> {
    let named = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().starts_with(beginning);
    let read = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = read.filter(named).map(|entry| entry.path()).collect();
    found.sort();
    found
}

fn existing(path: &Path, origin: &str) -> Result<PathBuf, InferError> {
    // The path must be absolute, because a bare name would be looked up in the system's library folders.
    match path.canonicalize() {
        Ok(path) if path.is_file() => Ok(path),
        Ok(_) => Err(InferError::RuntimeMissing { what: format!("{origin} is no file: {}", path.display()) }),
        Err(error) => Err(InferError::RuntimeMissing {
            what: format!("{origin} cannot be used: {error}: {}", path.display()),
        }),
    }
}

/// Returns the version, build and path of the runtime. The function loads the runtime if necessary.
///
/// # Errors
/// Returns [`InferError::RuntimeMissing`] if the runtime cannot be loaded.
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
    work(slot.insert(Runtime { environment, library, openvino_registered: false, is_logged: false }))
}

/// Forwards the runtime's messages to this program's log.
///
/// The runtime's warnings are about details of graphs, so users see them only in the debug log.
fn log(level: LogLevel, category: &str, _id: &str, _location: &str, message: &str) {
    match level {
        LogLevel::Error | LogLevel::Fatal => tracing::error!(category, "onnxruntime: {message}"),
        _ => tracing::debug!(category, "onnxruntime: {message}"),
    }
}

/// Returns the environment and the provider for new sessions. The choice of the provider is logged once per process.
pub(crate) fn prepare(
    explicit: Option<&Path>,
    choice: ProviderChoice,
) -> Result<(Environment, Provider), InferError> {
    with_runtime(explicit, |runtime| {
        let processor = Processor::here();
        let openvino = match choice {
            ProviderChoice::Openvino => Some(room_for_openvino().and_then(|()| register_openvino(runtime))),
            ProviderChoice::Auto if processor.bf16_matrices => {
                Some(room_for_openvino().and_then(|()| register_openvino(runtime)))
            }
            _ => None,
        };
        if let (ProviderChoice::Openvino, Some(Err(what))) = (choice, openvino.clone()) {
            return Err(InferError::ProviderUnavailable { provider: "openvino", what });
        }
        let provider = provider_for(choice, processor, matches!(openvino, Some(Ok(()))));
        if !std::mem::replace(&mut runtime.is_logged, true) {
            tracing::info!("{}", description(choice, provider, processor, openvino.and_then(Result::err)));
        }
        Ok((runtime.environment.clone(), provider))
    })
}

/// Returns the provider for the configured choice on this processor. `openvino` is true if OpenVINO can be used.
fn provider_for(choice: ProviderChoice, processor: Processor, openvino: bool) -> Provider {
    match choice {
        ProviderChoice::Openvino => Provider::OpenvinoBf16,
        ProviderChoice::Auto if processor.bf16_matrices && openvino => Provider::OpenvinoBf16,
        ProviderChoice::Int8 => Provider::Int8,
        ProviderChoice::Auto if processor.int8 => Provider::Int8,
        ProviderChoice::Auto | ProviderChoice::Cpu => Provider::Cpu,
    }
}

/// Describes the provider in one line, and names a faster provider if one is possible on this machine.
fn description(
    choice: ProviderChoice,
    provider: Provider,
    processor: Processor,
    no_openvino: Option<String>,
) -> String {
    let used = match provider {
        Provider::Cpu => "nets run in f32 on the CPU provider",
        Provider::Int8 => "nets run in int8 on the CPU provider",
        Provider::OpenvinoBf16 => "nets run in bf16 on OpenVINO",
    };
    let more = match (choice, provider, no_openvino) {
        (ProviderChoice::Auto, _, Some(what)) => {
            format!("; OpenVINO in bf16 would be faster here, but {what}")
        }
        (ProviderChoice::Auto, Provider::Cpu, None) => {
            "; this processor has neither VNNI for int8 nor AMX for bf16, which would be faster".to_owned()
        }
        (ProviderChoice::Auto, ..) => String::new(),
        (ProviderChoice::Int8, ..) if !processor.int8 => {
            ", as configured; without VNNI int8 is hardly faster here, and the measured accuracy does not apply"
                .to_owned()
        }
        (ProviderChoice::Cpu, ..) if processor.int8 => {
            ", as configured; infer.provider = \"auto\" would be faster here".to_owned()
        }
        _ => ", as configured".to_owned(),
    };
    format!("{used}{more}")
}

/// Checks the limit of the address space. If the limit is too small, OpenVINO returns wrong numbers.
fn room_for_openvino() -> Result<(), String> {
    match getrlimit(Resource::As).current {
        Some(limit) if limit < OPENVINO_SPACE => {
            Err(format!("ulimit -v allows {} MiB, it needs {}", limit >> 20, OPENVINO_SPACE >> 20))
        }
        _ => Ok(()),
    }
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
    // On processors of other makers, the plug-in can be loaded but offers no device.
    openvino_cpu(&runtime.environment)
        .map(|_| ())
        .ok_or_else(|| "the plug-in offers no CPU device".to_owned())
}

/// Returns the CPU device of the OpenVINO plug-in, if there is one.
pub(crate) fn openvino_cpu(environment: &Environment) -> Option<Device<'_>> {
    environment.devices().find(|device| {
        device.ep().is_ok_and(|ep| ep == OPENVINO_NAME) && device.hardware_device().ty() == DeviceType::CPU
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const OLD: Processor = Processor { int8: false, bf16_matrices: false };
    const VNNI: Processor = Processor { int8: true, bf16_matrices: false };
    const AMX: Processor = Processor { int8: true, bf16_matrices: true };

    #[test]
    fn auto_chooses_the_fastest_available_provider() {
        let auto = |processor, openvino| provider_for(ProviderChoice::Auto, processor, openvino);
        assert_eq!(auto(AMX, true), Provider::OpenvinoBf16);
        assert_eq!(auto(AMX, false), Provider::Int8);
        assert_eq!(auto(VNNI, true), Provider::Int8);
        assert_eq!(auto(OLD, true), Provider::Cpu);
        for processor in [OLD, VNNI, AMX] {
            assert_eq!(provider_for(ProviderChoice::Cpu, processor, true), Provider::Cpu);
            assert_eq!(provider_for(ProviderChoice::Int8, processor, true), Provider::Int8);
        }
    }

    #[test]
    fn a_library_from_pip_is_found_beside_the_program() {
        let prefix = tempfile::tempdir().unwrap();
        let packages = prefix.path().join("lib/python3.11/site-packages");
        let library = packages.join("onnxruntime/capi/libonnxruntime.so.1.31.1");
        std::fs::create_dir_all(library.parent().unwrap()).unwrap();
        std::fs::write(&library, "").unwrap();
        std::fs::create_dir_all(prefix.path().join("lib/perl5/site-packages")).unwrap();
        let found = python_packages(&prefix.path().join("bin/roadplane"));
        assert_eq!(found, std::slice::from_ref(&packages));
        assert_eq!(packaged_library(&packages), Some(library));
        assert_eq!(packaged_library(prefix.path()), None);
        assert_eq!(python_packages(Path::new("roadplane")), Vec::<PathBuf>::new());
    }

    #[test]
    fn a_faster_provider_is_named() {
        let absent = || Some("the plug-in is not there".to_owned());
        let auto = |provider, processor, why| description(ProviderChoice::Auto, provider, processor, why);
        assert_eq!(auto(Provider::Int8, VNNI, None), "nets run in int8 on the CPU provider");
        assert!(auto(Provider::Int8, AMX, absent()).contains("OpenVINO in bf16 would be faster here"));
        assert!(auto(Provider::Cpu, OLD, None).contains("VNNI"));
        assert!(description(ProviderChoice::Cpu, Provider::Cpu, VNNI, None).contains("auto"));
        assert!(description(ProviderChoice::Int8, Provider::Int8, OLD, None).contains("without VNNI"));
    }
}
