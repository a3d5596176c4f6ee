//! Errors that end a command, and their causes, which decide the exit code.

use std::any::Any;
use std::io::ErrorKind;
use std::path::PathBuf;

use roadplane_activity::ActivityError;
use roadplane_base::AtlasError;
use roadplane_decode::DecodeError;
use roadplane_detect::DetectError;
use roadplane_infer::InferError;
use roadplane_keypoints::KeypointError;
use roadplane_view::ViewError;
use roadplane_watch::WatchError;
use roadplane_write::WriteError;
use thiserror::Error;

use crate::config::ConfigError;

/// An error that ends a command or the work on one input.
#[derive(Debug, Error)]
pub enum PipelineError {
    /// The command line is wrong.
    #[error("{what}")]
    Usage {
        /// The problem and its remedy.
        what: String,
    },
    /// The configuration is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The input cannot be used.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// A file that the work needs cannot be read.
    #[error("cannot be read: {source}: {}", path.display())]
    Unreadable {
        /// The system's error.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The folder of the models was not found.
    #[error("no models found in {tried}; set ROADPLANE_MODELS or models.folder to their folder")]
    ModelsMissing {
        /// The folders that were searched.
        tried: String,
    },
    /// A net cannot be loaded or run.
    #[error(transparent)]
    Infer(#[from] InferError),
    /// The watcher failed on a picture.
    #[error(transparent)]
    Watch(#[from] WatchError),
    /// The detector cannot be used.
    #[error(transparent)]
    Detect(#[from] DetectError),
    /// The keypoint net cannot be used.
    #[error(transparent)]
    Keypoint(#[from] KeypointError),
    /// The activity net cannot be used, or a track is invalid.
    #[error(transparent)]
    Activity(#[from] ActivityError),
    /// The shape atlas cannot be used.
    #[error(transparent)]
    Atlas(#[from] AtlasError),
    /// Results cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Pictures cannot be drawn.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Standard output cannot be written to.
    #[error("standard output: {source}")]
    Stdout {
        /// The system's error.
        source: std::io::Error,
    },
    /// A thread cannot be started.
    #[error("a thread cannot be started: {source}")]
    Thread {
        /// The system's error.
        source: std::io::Error,
    },
    /// The work needs more memory than is allowed.
    #[error("too little memory: {what}")]
    Memory {
        /// The needed memory and the limit.
        what: String,
    },
    /// A stage panicked.
    #[error("internal error in stage {stage}: {message}")]
    Bug {
        /// Name of the stage.
        stage: &'static str,
        /// Message of the panic.
        message: String,
    },
    /// A signal asked the command to stop: Ctrl-C or SIGTERM.
    #[error("stopped by signal {signal}; the same command with --resume continues from here")]
    Stopped {
        /// Number of the signal.
        signal: usize,
    },
}

/// Cause of an error, which decides the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The command line, the configuration, or a missing file: exit code 2.
    Usage,
    /// A damaged or lost input: exit code 3.
    Input,
    /// A refused model: exit code 4.
    Model,
    /// An output folder that is in use: exit code 11.
    Locked,
    /// A signal: exit code 128 + its number.
    Stopped {
        /// Number of the signal.
        signal: usize,
    },
    /// This program or its machine: exit code 1.
    Internal,
}

impl PipelineError {
    /// Returns an error of the command line; `what` names the problem and its remedy.
    #[must_use]
    pub fn usage(what: &str) -> Self {
        Self::Usage { what: what.to_owned() }
    }

    pub(crate) fn thread(source: std::io::Error) -> Self {
        Self::Thread { source }
    }

    pub(crate) fn panicked(stage: &'static str, panic: &(dyn Any + Send)) -> Self {
        let text = panic.downcast_ref::<&str>().map(ToString::to_string);
        let message = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        Self::Bug { stage, message }
    }

    /// Returns the cause of the error.
    #[must_use]
    pub fn fault(&self) -> Fault {
        match self {
            Self::Usage { .. } | Self::Config(_) | Self::Decode(DecodeError::Option { .. }) => Fault::Usage,
            Self::Decode(DecodeError::Unreadable { source, .. })
            | Self::Unreadable { source, .. }
            | Self::Write(WriteError::Io { doing: "read", source, .. })
                if source.kind() == ErrorKind::NotFound =>
            {
                Fault::Usage
            }
            Self::Decode(DecodeError::Library { .. }) => Fault::Internal,
            Self::Decode(_) | Self::Unreadable { .. } => Fault::Input,
            Self::ModelsMissing { .. } | Self::Atlas(_) => Fault::Model,
            Self::Infer(error) | Self::Keypoint(KeypointError::Net(error)) => net_fault(error),
            Self::Watch(_) | Self::Detect(DetectError::Picture { .. }) => Fault::Internal,
            Self::Detect(DetectError::Option { .. }) => Fault::Usage,
            Self::Detect(error) => error.net().map_or(Fault::Model, net_fault),
            Self::Keypoint(KeypointError::UnsuitableNet { .. })
            | Self::Activity(ActivityError::UnsuitableNet { .. }) => Fault::Model,
            Self::Activity(ActivityError::Net(error)) => net_fault(error),
            Self::Activity(ActivityError::Motion(_)) => Fault::Input,
            Self::Write(WriteError::Locked { .. }) => Fault::Locked,
            Self::Write(
                WriteError::Exists { .. } | WriteError::BadStem { .. } | WriteError::Lacks { .. },
            ) => Fault::Usage,
            Self::Write(WriteError::Malformed { .. }) => Fault::Input,
            Self::Stopped { signal } => Fault::Stopped { signal: *signal },
            Self::Write(_)
            | Self::View(_)
            | Self::Stdout { .. }
            | Self::Thread { .. }
            | Self::Memory { .. }
            | Self::Bug { .. } => Fault::Internal,
        }
    }
}

fn net_fault(error: &InferError) -> Fault {
    match error {
        InferError::ModelRefused { .. } => Fault::Model,
        InferError::ProviderUnavailable { .. } => Fault::Usage,
        _ => Fault::Internal,
    }
}
