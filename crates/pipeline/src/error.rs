//! Errors that end a command. The cause of an error decides the exit code.

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
        /// Description of the problem and its remedy.
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
        /// The error of the operating system.
        source: std::io::Error,
        /// Path of the file.
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
    /// The watcher, which measures camera motion, failed on a picture.
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
    /// The atlas of car shapes cannot be used.
    #[error(transparent)]
    Atlas(#[from] AtlasError),
    /// Results cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Pictures cannot be drawn.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Writing to standard output failed.
    #[error("standard output: {source}")]
    Stdout {
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A thread cannot be started.
    #[error("a thread cannot be started: {source}")]
    Thread {
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The work needs more memory than the system allows.
    #[error("too little memory: {what}")]
    Memory {
        /// Description of the needed memory and of the limit.
        what: String,
    },
    /// A stage of the pipeline panicked.
    #[error("internal error in stage {stage}: {message}")]
    Bug {
        /// Name of the stage.
        stage: &'static str,
        /// Message of the panic.
        message: String,
    },
    /// A signal (Ctrl-C or SIGTERM) asked the command to stop.
    #[error("stopped by signal {signal}; the same command with --resume continues from here")]
    Stopped {
        /// Number of the signal.
        signal: usize,
    },
}

/// Cause of an error, which decides the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A wrong command line or configuration, or a missing file: exit code 2.
    Usage,
    /// A damaged or lost input: exit code 3.
    Input,
    /// A model that is missing or cannot be used: exit code 4.
    Model,
    /// An output folder that another process uses: exit code 11.
    Locked,
    /// A signal that asked the command to stop: exit code 128 plus the number of the signal.
    Stopped {
        /// Number of the signal.
        signal: usize,
    },
    /// A fault of this program or of the machine: exit code 1.
    Internal,
}

impl PipelineError {
    /// Returns a [`PipelineError::Usage`]. `what` describes the problem and its remedy.
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

    /// Returns the cause of this error.
    #[must_use]
    pub fn fault(&self) -> Fault {
        match self {
            Self::Usage { .. } | Self::Config(_) => Fault::Usage,
            Self::Decode(DecodeError::Option { .. } | DecodeError::Stream { .. }) => Fault::Usage,
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
