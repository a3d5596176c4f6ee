//! Tests `roadplane-lab eval dataset` on a tenth of the data set in the repository. The tables of Li et al., *Car Pose
//! in Context*, must have all rows, in the right order of accuracy.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{lab, names, root};

type Rows = BTreeMap<String, BTreeMap<String, f64>>;

/// Reads the rows of a table by the name of the system. Each row has its numbers by column.
fn rows(path: &Path) -> Rows {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let cells = reader.deserialize().map(|row| -> BTreeMap<String, String> { row.unwrap() });
    cells
        .map(|row| {
            let name = row["system"].clone();
            (name, row.into_iter().map(|(head, cell)| (head, cell.parse().unwrap_or(f64::NAN))).collect())
        })
        .collect()
}

#[test]
fn a_tenth_of_the_data_set_gives_the_papers_tables() {
    let out = tempfile::tempdir().unwrap();
    let command = lab()
        .args(["eval", "dataset", "tests/data/lots", "--part", "0.1", "--out"])
        .arg(out.path())
        .assert()
        .code(0);
    let printed = String::from_utf8(command.get_output().stdout.clone()).unwrap();
    for title in
        ["Table 1, ADD", "Table 2, viewpoint", "Position", "Reprojection", "Video alone: camera", "HOTA"]
    {
        assert!(printed.contains(title), "{title}");
    }
    let files = names(out.path());
    let table = |start: &str, keypoints: &str| {
        let is = |name: &&String| name[3..].starts_with(start) && name.contains(keypoints);
        rows(&out.path().join(files.iter().find(is).unwrap()))
    };
    for (keypoints, ground_limit) in [("net", "1.6 d, %"), ("true", "0.4 d, %")] {
        let (add, viewpoint) = (table("table-1-add", keypoints), table("table-2-viewpoint", keypoints));
        let within = |rows: &Rows, system: &str, column: &str| -> f64 {
            rows.iter().find(|(name, _)| name.starts_with(system)).unwrap().1[column]
        };
        let of_true_ground = within(&add, "(true ground", ground_limit);
        let add = |system: &str| within(&add, system, "0.4 d, %");
        let viewpoint = |system: &str| within(&viewpoint, system, "0.14 rad, %");
        // Solutions with a common ground plane must be better than those of single cars, both by this project's solver
        // and by the baselines.
        for alone in ["1", "2", "3"] {
            assert!(add("4") > add(alone) + 5.0, "{keypoints}: {} {}", add("4"), add(alone));
            assert!(viewpoint("4") >= viewpoint(alone), "{keypoints}: {}", viewpoint("4"));
            assert!(add(alone) > 15.0 && viewpoint(alone) > 70.0, "{keypoints}: row {alone}");
        }
        assert!(of_true_ground >= 99.0, "{keypoints}: {of_true_ground}");
        let cameras = table("camera-from-single-frames", keypoints);
        let five = &cameras["5 ours, focal estimated, ≥ 5 cars"];
        assert!(five["focal, median %"] < 15.0 && five["tilt, median °"] < 1.5, "{keypoints}: {five:?}");
    }
    let page = std::fs::read_to_string(out.path().join("report.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("</html>"));
    assert!(root().join("tests/data/lots/dataset.json").is_file());
}

#[test]
fn a_folder_that_is_no_data_set_is_named() {
    let empty = tempfile::tempdir().unwrap();
    let command = lab().args(["eval", "dataset"]).arg(empty.path()).assert().code(3);
    let stderr = String::from_utf8(command.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("dataset.json"), "{stderr}");
    let command = lab().args(["eval", "dataset", "tests/data/lots", "--part", "2"]).assert().code(2);
    let stderr = String::from_utf8(command.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("between 0 and 1"), "{stderr}");
}
