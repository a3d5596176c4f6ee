//! Checks, before a run starts, that the process may use enough memory. C++ libraries that run out of memory may end
//! the process without a message.

use std::path::Path;

use roadplane_base::ImageSize;
use rustix::process::{Resource, getrlimit};

use crate::PipelineError;

const MIB: u64 = 1 << 20;
/// Least address space that a command needs, bytes. It covers the loaded libraries and the work of ending the command
/// properly.
const LEAST_SPACE: u64 = 900 * MIB;
/// Address space that nets, threads and their heaps take in addition to the libraries, bytes.
///
/// A whole run takes 1.25 GiB at 720p and 1.53 GiB at 1080p, as measured. The libraries take 0.4 GiB of these amounts.
const RUN_SPACE: u64 = 640 * MIB;
/// Address space that a run takes in addition for each pixel of a frame, bytes.
const SPACE_BY_PIXEL: u64 = 192;
/// Memory that every run uses, whatever the frame size, bytes. A whole run uses 293 MB at 720p and 345 MB at 1080p, as
/// measured.
const RUN_MEMORY: u64 = 240 * MIB;
/// Memory that a run uses in addition for each pixel of a frame, bytes.
const MEMORY_BY_PIXEL: u64 = 48;

/// Returns the limit on the address space (`ulimit -v`), MiB, if it is too small to load the libraries.
#[must_use]
pub fn too_small_address_space() -> Option<u64> {
    getrlimit(Resource::As).current.filter(|limit| *limit < LEAST_SPACE).map(|limit| limit / MIB)
}

/// Checks that a run on frames of this size stays below the memory limits of the process.
///
/// # Errors
/// Returns [`PipelineError::Memory`], which names the limit, if the run needs more memory.
pub(crate) fn check_memory(size: ImageSize) -> Result<(), PipelineError> {
    let pixels = u64::from(size.width) * u64::from(size.height);
    let space = status_bytes("VmSize:").and_then(|used| {
        let limit = getrlimit(Resource::As).current?;
        Some(("ulimit -v", limit, used))
    });
    let memory = std::fs::read_to_string("/proc/self/cgroup").ok().and_then(|groups| {
        let (name, limit) = cgroup_limit(Path::new("/sys/fs/cgroup"), &groups)?;
        Some((name, limit, status_bytes("VmRSS:")?))
    });
    let needs =
        [(space, RUN_SPACE + SPACE_BY_PIXEL * pixels), (memory, RUN_MEMORY + MEMORY_BY_PIXEL * pixels)];
    for (limit, need) in needs {
        let Some((name, limit, used)) = limit else { continue };
        if used + need > limit {
            let [limit, need] = [limit, used + need].map(|bytes| bytes / MIB);
            let ImageSize { width, height } = size;
            return Err(PipelineError::Memory {
                what: format!(
                    "pictures of {width}×{height} px need about {need} MiB, but {name} allows {limit} MiB: raise it"
                ),
            });
        }
    }
    Ok(())
}

/// Returns the lowest memory limit of a process's control groups and of their parents: its name, and its value in
/// bytes.
///
/// `root` is the folder `/sys/fs/cgroup`, and `groups` is the text of the file `/proc/self/cgroup`. Control groups of
/// version 2 form one tree. Version 1 has a separate tree for memory.
fn cgroup_limit(root: &Path, groups: &str) -> Option<(&'static str, u64)> {
    let limits = groups.lines().filter_map(|line| {
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, own) = (fields.next()?, fields.next()?.trim_start_matches('/'));
        let (tree, file, name) = match controllers {
            "" => (root.to_path_buf(), "memory.max", "memory.max of the control group"),
            _ if controllers.split(',').any(|controller| controller == "memory") => {
                let name = "memory.limit_in_bytes of the control group";
                (root.join("memory"), "memory.limit_in_bytes", name)
            }
            _ => return None,
        };
        let folder = tree.join(own);
        let within = folder.ancestors().take_while(|folder| folder.starts_with(&tree));
        let limit = |folder: &Path| std::fs::read_to_string(folder.join(file)).ok()?.trim().parse().ok();
        within.filter_map(limit).min().map(|limit: u64| (name, limit))
    });
    limits.min_by_key(|(_, limit)| *limit)
}

/// Returns a value from the file `/proc/self/status`, bytes. `name` is the start of the line that has the value.
pub(crate) fn status_bytes(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(name))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_without_limits_may_run() {
        assert!(too_small_address_space().is_none());
        check_memory(ImageSize { width: 1920, height: 1080 }).unwrap();
        assert!(status_bytes("VmSize:").unwrap() > MIB);
    }

    #[test]
    fn the_tightest_limit_of_all_control_groups_counts() {
        let root = tempfile::tempdir().unwrap();
        let put = |file: &str, text: &str| {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        let found = |groups: &str| cgroup_limit(root.path(), groups).map(|(_, limit)| limit);
        put("night/clip/memory.max", "max\n");
        assert_eq!(found("0::/night/clip\n"), None);
        put("night/memory.max", "2000\n");
        assert_eq!(found("0::/night/clip\n"), Some(2000));
        assert_eq!(found("0::/other\n"), None);
        // Control groups of version 1. Inside a container, the container's group is the top of the tree, even if the
        // process reads a longer name for it.
        put("memory/memory.limit_in_bytes", "1500\n");
        put("memory/night/memory.limit_in_bytes", "9223372036854771712\n");
        let first = "12:cpuset:/\n4:cpu,memory:/night\n";
        assert_eq!(found(first), Some(1500));
        assert_eq!(found("4:memory:/outside/of/it\n"), Some(1500));
        assert_eq!(found(&format!("{first}0::/night\n")), Some(1500));
        assert_eq!(found("4:memory\nnonsense\n\n"), None);
    }
}
