//! Tests `roadplane-lab eval`: its tables are printed and written, and their numbers are right.

use std::collections::BTreeMap;

use crate::common::{first_row, json, lab, names, roadplane, root, shared};

#[test]
#[ignore = "reads ../shared/data, which not everybody has; scripts/test runs it where it is"]
fn the_keypoint_net_is_accurate_on_labelled_real_cars() {
    let folder = shared("keypoints");
    let out = tempfile::tempdir().unwrap();
    for boxes in ["true", "detected"] {
        let labels = folder.join("virat_0401.json");
        let command = lab()
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
        // These limits detect a loss of accuracy. The exact numbers are in models/hourglass.md.
        assert!(row["median, %"] < 3.0 && row["PCK@0.1, %"] > 95.0, "{row:?}");
        assert_eq!(row["left/right"] + row["front/back"] + row["turned round"], 0.0);
    }
    assert!(names(out.path()).contains(&"worst.png".to_owned()));
}

#[test]
fn the_solvers_tables_are_printed_and_noise_free_scenes_are_exact() {
    let out = tempfile::tempdir().unwrap();
    let command = lab().args(["eval", "solver", "--scenes", "6", "--out"]).arg(out.path()).assert().code(0);
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
fn a_label_file_with_a_fault_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let labels = folder.path().join("labels.json");
    std::fs::write(&labels, r#"{"image": "a.png", "cars": [{"box": [0, 0, 0, 9], "keypoints": {}}]}"#)
        .unwrap();
    let command = lab()
        .args(["eval", "keypoints", "--truth"])
        .arg(&labels)
        .arg("--images")
        .arg(folder.path())
        .assert()
        .code(3);
    let stderr = String::from_utf8(command.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("car 0") && stderr.contains("labels.json"), "{stderr}");
}

#[test]
fn a_run_is_compared_with_a_camera_or_with_boxes_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let frames = root().join("tests/data/lot.mp4");
    roadplane()
        .arg("run")
        .arg(frames)
        .arg("--out")
        .arg(folder.path())
        .args(["--set", "decode.max_frames=1"])
        .assert()
        .code(0);
    // The camera is 10 m above the ground and tilted by 0.3 rad. The first file has the picture size of the run. The
    // second file has another size.
    let camera = |cx: f64, cy: f64| {
        let (sin, cos) = 0.3f64.sin_cos();
        format!(
            "1360 0 {cx}\n0 1360 {cy}\n0 0 1\n\n1 0 0\n0 {0} {1}\n0 {2} {0}\n\n0 {3} {4}\n\n0\n",
            -sin,
            -cos,
            cos,
            10.0 * cos,
            10.0 * sin
        )
    };
    std::fs::write(at("right.krtd"), camera(639.5, 359.5)).unwrap();
    std::fs::write(at("wrong.krtd"), camera(959.5, 539.5)).unwrap();
    let eval = |truth: &str| {
        let mut command = lab();
        command.args(["eval", "run"]).arg(at("lot")).arg("--truth").arg(at(truth));
        command.arg("--out").arg(at("tables")).assert()
    };
    eval("right.krtd").code(0);
    let row = first_row(&at("tables/01-camera.csv"));
    assert!((row["truth"] - 1360.0).abs() < 1e-6, "{row:?}");
    let refused = eval("wrong.krtd").code(2);
    let stderr = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("1280 × 720") && stderr.contains("1920 × 1080"), "{stderr}");
    eval("none.json").code(3);

    // The same run is compared with boxes alone: the boxes of the first frame's cars, as a KPF file.
    let truth = json(&root().join("tests/data/lot.truth.json"));
    let (mut boxes, mut types) = (String::new(), String::new());
    for car in truth["frames"][0]["cars"].as_array().unwrap() {
        let side: Vec<String> = car["box"].as_array().unwrap().iter().map(ToString::to_string).collect();
        let hidden = if car["visible_share"].as_f64().unwrap() < 0.3 { ", occlusion: mostly" } else { "" };
        boxes += &format!("- {{ geom: {{ id1: {}, ts0: 0, g0: {}{hidden} }} }}\n", car["id"], side.join(" "));
        types += &format!("- {{ types: {{ id1: {}, cset3: {{ Vehicle: 1.0 }} }} }}\n", car["id"]);
    }
    std::fs::write(at("boxes.geom.yml"), boxes).unwrap();
    std::fs::write(at("types.yml"), types).unwrap();
    eval("boxes.geom.yml").code(0);
    let row = first_row(&at("tables/01-boxes-of-cars-that-got-a.csv"));
    assert!(row["AP50, %"] > 70.0 && row["pictures"] == 1.0, "{row:?}");
}

#[test]
fn a_copy_of_kitti_is_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    let training = folder.path().join("training");
    for part in ["image_2", "label_2", "calib"] {
        std::fs::create_dir_all(training.join(part)).unwrap();
    }
    let car = "Car 0 0 0 100 150 220 210 1.5 1.6 4.0 -2 1.6 20 1.5\n";
    for (name, cars) in [("000000", 5), ("000001", 3)] {
        std::fs::write(training.join(format!("label_2/{name}.txt")), car.repeat(cars)).unwrap();
        std::fs::write(training.join(format!("calib/{name}.txt")), "P2: 720 0 600 45 0 720 170 0 0 0 1 0\n")
            .unwrap();
        image::RgbImage::from_pixel(1242, 375, image::Rgb([128, 128, 128]))
            .save(training.join(format!("image_2/{name}.png")))
            .unwrap();
    }
    let eval = |folder: &std::path::Path| {
        lab().args(["eval", "kitti"]).arg(folder).arg("--out").arg(folder.join("out")).assert()
    };
    eval(folder.path()).code(0);
    // The only image with more than three vehicles has five cars. The picture is grey, so no car is detected.
    let row = first_row(&folder.path().join("out/01-table-3-add-kitti.csv"));
    assert_eq!(row["cars"], 5.0);
    assert!(row["0.1 d, %"] < 50.0, "{row:?}");
    std::fs::write(training.join("label_2/000000.txt"), "Car 0 zero\n").unwrap();
    let refused = eval(folder.path()).code(3);
    let stderr = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("line 1") && stderr.contains("label_2/000000.txt"), "{stderr}");
}

#[test]
fn reference_cameras_are_measured_and_the_worst_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let camera = &json(&root().join("tests/data/lot.truth.json"))["camera"];
    let cameras = serde_json::json!({
        "schema": "roadplane.cameras/1",
        "cameras": [{
            "id": "rendered lot",
            "file": root().join("tests/data/lot.mp4"),
            "image_size_px": camera["image_size_px"],
            "focal_px": camera["focal_px"],
            "principal_point_px": camera["principal_point_px"],
            "distortion_k1_k2": [0.0, 0.0],
            "height_m": camera["height_m"],
            "normal_in_camera": camera["plane_in_camera"]["normal"],
            "sd": { "focal_share": 0.001, "tilt_deg": 0.01, "roll_deg": 0.01, "height_share": 0.001 },
        }],
    });
    std::fs::write(folder.path().join("cameras.json"), cameras.to_string()).unwrap();
    let out = folder.path().join("out");
    let mut command = lab();
    command.args(["eval", "cameras"]).arg(folder.path()).arg("--out").arg(&out);
    command.args(["--set", "decode.max_frames=12"]).assert().code(0);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert_eq!(page.matches("<figure>").count(), 1);
    assert!(page.contains("rendered lot: focal length") && page.contains("truth 1360"));
    assert!(out.join("runs/lot/frames.jsonl").is_file(), "kept for a later call");
}

#[test]
fn films_of_a_moving_camera_are_compared_with_the_film_at_rest() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("tables");
    lab()
        .args([
            "eval",
            "motion",
            "tests/data/lot.mp4",
            "--seconds",
            "1",
            "--focal-px",
            "1100",
            "--given-focal",
            "--motions",
            "sway_3px",
            "zoom",
            "far_pan",
            "tour",
        ])
        .args(["--set", "decode.start_s=1", "--out"])
        .arg(&out)
        .current_dir(root())
        .assert()
        .code(0);
    let table = names(&out).into_iter().find(|name| name.ends_with(".csv")).unwrap();
    let mut reader = csv::Reader::from_path(out.join(table)).unwrap();
    let rows: Vec<BTreeMap<String, String>> = reader.deserialize().map(Result::unwrap).collect();
    let motions: Vec<&str> = rows.iter().map(|row| row["motion"].as_str()).collect();
    assert_eq!(motions, ["rest", "sway_3px", "zoom", "far_pan", "tour"]);
    for row in rows.iter().filter(|row| ["rest", "sway_3px", "zoom"].contains(&row["motion"].as_str())) {
        let number = |column: &str| row[column].parse::<f64>().unwrap();
        assert!(number("tracks") > 0.0 && number("observed, %") > 90.0, "{row:?}");
    }
    let films = names(&out.join("films"));
    assert!(films.contains(&"lot_far_pan.mp4".to_owned()), "{films:?}");
}
