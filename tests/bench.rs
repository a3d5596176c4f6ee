//! Tests `roadplane-lab bench`: all rows are present, and all numbers are plausible. The speed itself is not tested.

use crate::common::{lab, names, number, root};

#[test]
fn a_bench_lists_the_cost_of_each_stage() {
    let here = tempfile::tempdir().unwrap();
    let clip = root().join("tests/data/lot.mp4");
    let bench = |arguments: &[&str]| {
        let mut command = lab();
        command.current_dir(here.path()).args(["bench", "--set", "decode.end_s=2"]).arg(&clip);
        command.args(["--set", &format!("models.folder={:?}", root().join("models"))]);
        let done = command.args(arguments).assert().code(0);
        String::from_utf8(done.get_output().stdout.clone()).unwrap()
    };
    let table = bench(&["--full"]);
    for row in ["frames/s", "CPU ms a frame", "  decode", "  solve", "times decoding alone", "cores busy"] {
        assert!(table.lines().any(|line| line.starts_with(row)), "{row} is missing in\n{table}");
    }
    assert!(table.contains("attention") && table.contains("full"), "{table}");
    assert_eq!(names(here.path()), [""; 0], "the runs' results are gone");

    let page: serde_json::Value = serde_json::from_str(&bench(&["--json", "--out", "kept"])).unwrap();
    assert!(here.path().join("kept/attention/lot/summary.json").is_file());
    assert!(number(&page["decoding_alone"]["cpu_ms_per_frame"]) > 0.0);
    let run = &page["runs"][0];
    for field in ["frames_per_s", "times_real_time", "times_decoding_alone", "looks_per_s"] {
        assert!(number(&run[field]) > 0.0, "{field}: {run}");
    }
    let speed = &run["speed"];
    assert!((0.0..=1.0).contains(&number(&speed["seen_share"])), "{speed}");
    let ms = &speed["cpu_ms_per_frame"];
    let stages = ["open", "decode", "watch", "detect", "keypoints", "spool", "solve", "write"];
    assert!(stages.iter().all(|stage| number(&ms[*stage]) > 0.0), "{ms}");
    let sum: f64 = stages.iter().map(|stage| number(&ms[*stage])).sum();
    assert!((sum - number(&ms["total"])).abs() < 0.01, "{ms}");
    assert!(number(&ms["detect_net"]) <= number(&ms["detect"]), "{ms}");
    assert!(number(&ms["keypoints_net"]) <= number(&ms["keypoints"]), "{ms}");
}
