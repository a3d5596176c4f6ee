//! A sandbox for runs. A run can read only its inputs, models and libraries, can write only its output, and cannot
//! reach a network.
//!
//! Some video files are made to exploit errors in codecs. In the sandbox, such a file can do little harm.
//!
//! The sandbox uses Landlock of Linux (from kernel 5.13; for networks from 6.7). Landlock permanently restricts the
//! calling thread and all threads that it starts later. If the kernel lacks a part of Landlock, the run continues
//! without that protection.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use landlock::{
    ABI, Access as _, AccessFs, AccessNet, NetPort, PathBeneath, PathFd, Ruleset, RulesetAttr as _,
    RulesetCreatedAttr as _, RulesetError, RulesetStatus, path_beneath_rules,
};
use roadplane_pipeline::{find_models, find_runtime};

/// Version of Landlock that is requested from the kernel.
const WANTED: ABI = ABI::V5;
/// Paths that libraries read: code and data of the system, and information on processor and memory.
const SYSTEM: [&str; 11] = [
    "/usr",
    "/lib",
    "/lib64",
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/dev/urandom",
    "/sys",
    "/proc/self",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
];

/// Paths and addresses that a command needs in addition to [`SYSTEM`].
#[derive(Clone, Debug, Default)]
pub struct Needs {
    /// Files and folders to read. Missing files and folders are ignored.
    pub reads: Vec<PathBuf>,
    /// Folders to write.
    pub writes: Vec<PathBuf>,
    /// Address at which the command serves its counts (option `--metrics`).
    pub serves: Option<SocketAddr>,
}

impl Needs {
    /// Returns the paths that nets need: the folder of the models, the targets of links in it, and the folder of ONNX
    /// Runtime.
    pub fn of_nets(models: Option<&Path>) -> Self {
        let runtime = find_runtime().ok().and_then(|library| Some(library.parent()?.to_path_buf()));
        let models = find_models(models).ok();
        let entries = models.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
        let targets: Vec<PathBuf> = entries.filter_map(|entry| entry.path().canonicalize().ok()).collect();
        Self { reads: models.into_iter().chain(targets).chain(runtime).collect(), ..Self::default() }
    }

    /// Adds paths to read.
    #[must_use]
    pub fn reading<'a>(mut self, paths: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        self.reads.extend(paths.into_iter().cloned());
        self
    }

    /// Adds a folder to write, and creates it if it is missing.
    ///
    /// If the folder cannot be created, the first write to the folder reports the error.
    #[must_use]
    pub fn writing(mut self, folder: &Path) -> Self {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let _shows_at_first_write = std::fs::create_dir_all(folder);
        self.writes.push(folder.to_path_buf());
        self
    }

    /// Adds the folder that contains a file to write.
    #[must_use]
    pub fn writing_file(self, file: &Path) -> Self {
        self.writing(file.parent().unwrap_or(Path::new("")))
    }
}

/// Enters the sandbox: this thread, and all threads that it starts later, lose all access that `needs` does not list.
///
/// Call this function before any other thread starts.
pub fn enter(needs: &Needs) {
    match restrict(needs) {
        Ok(RulesetStatus::FullyEnforced) => tracing::debug!("in a sandbox"),
        Ok(RulesetStatus::PartiallyEnforced) => {
            tracing::debug!("in a sandbox, with the part of Landlock that this kernel has")
        }
        Ok(RulesetStatus::NotEnforced) => tracing::debug!("no sandbox: this kernel has no Landlock"),
        Err(error) => tracing::warn!("the run continues without a sandbox: {error}"),
    }
}

fn restrict(needs: &Needs) -> Result<RulesetStatus, RulesetError> {
    let read = AccessFs::from_read(WANTED);
    let mut rules = Ruleset::default()
        .handle_access(AccessFs::from_all(WANTED))?
        .handle_access(AccessNet::from_all(WANTED))?
        .create()?
        .add_rules(path_beneath_rules(SYSTEM, read))?
        .add_rules(path_beneath_rules(&needs.reads, read))?
        .add_rules(path_beneath_rules(&needs.writes, AccessFs::from_all(WANTED)))?;
    if let Ok(null) = PathFd::new("/dev/null") {
        rules = rules.add_rule(PathBeneath::new(null, AccessFs::ReadFile | AccessFs::WriteFile))?;
    }
    if let Some(address) = needs.serves {
        rules = rules.add_rule(NetPort::new(address.port(), AccessNet::BindTcp))?;
    }
    Ok(rules.restrict_self()?.ruleset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::io::ErrorKind::PermissionDenied;
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn nothing_else_can_be_read_written_or_reached() {
        let temp = tempfile::tempdir().unwrap();
        let [input, other, out] = ["input", "other", "out"].map(|name| temp.path().join(name));
        fs::write(&input, "a clip").unwrap();
        fs::write(&other, "a secret").unwrap();
        std::os::unix::fs::symlink(&other, temp.path().join("link")).unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let needs = Needs::default().reading([&input]).writing(&out);
        // The test runs in a separate thread, because the restriction is permanent.
        let inside = std::thread::Builder::new().spawn(move || {
            let status = restrict(&needs).unwrap();
            if status == RulesetStatus::NotEnforced {
                println!("skipped: this kernel has no Landlock");
                return;
            }
            let denied = |result: std::io::Result<()>| result.unwrap_err().kind() == PermissionDenied;
            assert_eq!(fs::read_to_string(&input).unwrap(), "a clip");
            fs::write(out.join("made"), "here").unwrap();
            fs::rename(out.join("made"), out.join("kept")).unwrap();
            assert!(denied(fs::read("/etc/passwd").map(drop)));
            assert!(denied(fs::read(&other).map(drop)));
            assert!(denied(fs::read(input.with_file_name("link")).map(drop)));
            assert!(denied(fs::write(&input, "")));
            assert!(denied(fs::write(input.with_file_name("new"), "")));
            assert!(denied(fs::read_dir("/root").map(drop)));
            if status == RulesetStatus::FullyEnforced {
                assert!(denied(TcpStream::connect(address).map(drop)));
                assert!(denied(TcpListener::bind("127.0.0.1:0").map(drop)));
            } else {
                println!("skipped: Landlock of this kernel does not restrict networks");
            }
        });
        inside.unwrap().join().unwrap();
        assert!(TcpStream::connect(address).is_ok(), "other threads keep their access");
    }
}
