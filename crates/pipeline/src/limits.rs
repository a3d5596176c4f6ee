//! Checks before the work starts whether the process may use enough memory. Libraries in C++ may end a process without
//! a message when they run out of memory.

use std::path::Path;

use roadplane_base::ImageSize;
use rustix::process::{Resource, getrlimit};

use crate::PipelineError;

const MIB: u64 = 1 << 20;
/// Address space, bytes, that the loaded libraries take and that commands need to end in order.
const LEAST_SPACE: u64 = 900 * MIB;
/// Address space, bytes, that nets, threads and their heaps take beside the libraries. Measured: 1.25 GiB at 720p, 1.53
/// GiB at 1080p, 0.4 GiB of it for the libraries.
const RUN_SPACE: u64 = 640 * MIB;
/// Further address space per pixel of the picture, bytes.
const SPACE_BY_PIXEL: u64 = 192;
/// Memory that a run uses, bytes. Measured: 293 MB at 720p, 345 MB at 1080p.
const RUN_MEMORY: u64 = 240 * MIB;
/// Further memory per pixel of the picture, bytes.
const MEMORY_BY_PIXEL: u64 = 48;

/// Returns the limit on the address space (`ulimit -v`), MiB, if it is too small to load the libraries.
#[must_use]
pub fn too_small_address_space() -> Option<u64> {
    getrlimit(Resource::As).current.filter(|limit| *limit < LEAST_SPACE).map(|limit| limit / MIB)
}

/// Refuses a run that would reach a limit on memory.
///
/// # Errors
/// [`PipelineError::Memory`] with the limit.
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

/// Returns name and value, bytes, of the tightest memory limit of a process's control groups and their parents.
///
/// `groups` is the text of `/proc/self/cgroup`. Version 2 has one tree; version 1 has a separate tree for memory.
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

/// Returns a value of `/proc/self/status`, bytes; `name` is the start of its line.
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
        // Version 1. Within a container the own group is the top of the tree, whatever its name outside.
        put("memory/memory.limit_in_bytes", "1500\n");
        put("memory/night/memory.limit_in_bytes", "9223372036854771712\n");
        let first = "12:cpuset:/\n4:cpu,memory:/night\n";
        assert_eq!(found(first), Some(1500));
        assert_eq!(found("4:memory:/outside/of/it\n"), Some(1500));
        assert_eq!(found(&format!("{first}0::/night\n")), Some(1500));
        assert_eq!(found("4:memory\nnonsense\n\n"), None);
    }
}
