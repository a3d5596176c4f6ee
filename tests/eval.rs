//! `roadplane eval`: its tables are printed, written, and say what is so.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{names, roadplane, shared};

/// The first row of a CSV file by column; NaN where there is no number.
fn first_row(path: &Path) -> BTreeMap<String, f64> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let row: BTreeMap<String, String> = reader.deserialize().next().unwrap().unwrap();
    row.into_iter().map(|(head, cell)| (head, cell.parse().unwrap_or(f64::NAN))).collect()
}

#[test]
fn the_keypoint_net_holds_on_labelled_real_cars() {
    let Some(folder) = shared("keypoints") else { return };
    let out = tempfile::tempdir().unwrap();
    for boxes in ["true", "detected"] {
        let labels = folder.join("virat_0401.json");
        let command = roadplane()
            .args(["eval", "keypoints", "--boxes", boxes, "--truth"])
            .arg(labels)
            .arg("--images")
            .arg(&folder)
            .arg("--out")
            .arg(out.path())
            .assert()
            .code(0);
        let printed = String::from_utf8(command.get_output().stdout.clone()).unwrap();
        assert!(printed.contains("virat_0401") && printed.contains("windscreen_top"), "{printed}");
        let row = first_row(&out.path().join("01-keypoints.csv"));
        assert_eq!(row["cars"], 9.0);
        // Guards against getting worse; the bars stand in models/hourglass.md.
        assert!(row["median, %"] < 3.5 && row["PCK@0.1, %"] > 93.0, "{row:?}");
        assert_eq!(row["left/right"] + row["front/back"] + row["turned round"], 0.0);
    }
    assert!(names(out.path()).contains(&"worst.png".to_owned()));
}

#[test]
fn the_solvers_tables_are_printed_and_honest() {
    let out = tempfile::tempdir().unwrap();
    let command =
        roadplane().args(["eval", "solver", "--scenes", "6", "--out"]).arg(out.path()).assert().code(0);
    let printed = String::from_utf8(command.get_output().stdout.clone()).unwrap();
    for title in ["Noise-free scenes", "Cramér–Rao", "Ablation: ADD", "Fused over 100 frames", "Speed"] {
        assert!(printed.contains(title), "{title}");
    }
    let exact = first_row(&out.path().join("01-noise-free-scenes.csv"));
    assert_eq!(exact["exact, %"], 100.0);
    let page = std::fs::read_to_string(out.path().join("report.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("</html>"));
}

#[test]
fn what_cannot_be_evaluated_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let labels = folder.path().join("labels.json");
    std::fs::write(&labels, r#"{"image": "a.png", "cars": [{"box": [0, 0, 0, 9], "keypoints": {}}]}"#)
        .unwrap();
    let command = roadplane()
        .args(["eval", "keypoints", "--truth"])
        .arg(&labels)
        .arg("--images")
        .arg(folder.path())
        .assert()
        .code(3);
    let said = String::from_utf8(command.get_output().stderr.clone()).unwrap();
    assert!(said.contains("car 0") && said.contains("labels.json"), "{said}");
}
