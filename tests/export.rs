//! `roadplane export`: what it refuses. What it writes is tested in its crate.

use crate::common::{names, roadplane};

#[test]
fn formats_are_listed_and_unknown_ones_refused() {
    let list = roadplane().args(["export", "--format", "list"]).output().unwrap();
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(list.status.success());
    for name in ["mot", "kitti", "kpf", "actev", "geojson", "sumo-fcd", "ngsim", "highd", "rerun"] {
        assert!(text.lines().any(|line| line.starts_with(&format!("{name} "))), "{name}: {text}");
    }
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("out");
    for (format, word) in [("mott", "there is no format"), ("rerun", "scripts/export/rerun")] {
        let failed =
            roadplane().args(["export", "results/none", "--format", format, "--out"]).arg(&folder).output();
        let failed = failed.unwrap();
        assert_eq!(failed.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&failed.stderr).contains(word));
    }
    assert!(!folder.exists());
}

#[test]
fn a_folder_that_is_no_run_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let failed =
        roadplane().arg("export").arg(dir.path()).args(["--format", "mot", "--out"]).arg(&out).output();
    let failed = failed.unwrap();
    assert_eq!(failed.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&failed.stderr).contains("summary.json"));
    assert_eq!(names(dir.path()), Vec::<String>::new());
}
