//! Tests `roadplane-lab synth`. The command `roadplane stage solve` reads the scenes, and its camera must agree with
//! the truth.

use std::path::Path;

use crate::common::{json, json_lines, lab, names, number, roadplane};

fn synth(out: &Path, stills: u32, clips: u32, more: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = lab();
    command.arg("synth").arg("--out").arg(out);
    command.args(["--stills", &stills.to_string(), "--clips", &clips.to_string()]);
    command.args(["--seconds", "2", "--fps", "5", "--cars", "14"]).args(more).assert()
}

#[test]
fn the_camera_agrees_with_the_truth_within_its_sd() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    synth(&out, 12, 1, &["--seed", "3"]).code(0);
    let (mut focal, mut height, mut tilt) = (Vec::new(), Vec::new(), Vec::new());
    for still in 0..12 {
        let truth = &json(&out.join(format!("scenes/still_{still:04}.truth.json")))["camera"];
        let solved = folder.path().join(format!("{still}"));
        std::fs::create_dir(&solved).unwrap();
        roadplane()
            .arg("solve")
            .arg(out.join(format!("scenes/still_{still:04}.frames.jsonl")))
            .arg("--out")
            .arg(solved.join("poses.jsonl"))
            .assert()
            .code(0);
        let camera = json(&solved.join("camera.json"));
        let off =
            |name: &str, sd: &str| (number(&camera[name]) - number(&truth[name])).abs() / number(&camera[sd]);
        focal.push(off("focal_px", "focal_sd_px"));
        height.push(off("height_m", "height_sd_m"));
        tilt.push(off("tilt_rad", "tilt_sd_rad"));
    }
    // One of 12 normal errors exceeds 3.5 sd in about one of a hundred runs. The seed is fixed.
    for errors in [focal, height, tilt] {
        assert!(errors.iter().all(|e| *e < 3.5), "{errors:?}");
        assert!(errors.iter().filter(|e| **e < 1.5).count() >= 6, "{errors:?}");
    }
}

#[test]
fn a_clip_agrees_with_its_truth() {
    let folder = tempfile::tempdir().unwrap();
    synth(folder.path(), 0, 1, &["--noise", "0"]).code(0);
    let scenes = folder.path().join("scenes");
    let truth = json(&scenes.join("clip_0000.truth.json"));
    let frames = json_lines(&scenes.join("clip_0000.frames.jsonl"));
    assert_eq!(frames.len(), 10);
    let mut observed = Vec::new();
    for (found, frame) in frames.iter().zip(truth["frames"].as_array().unwrap()) {
        assert_eq!(found["time_s"], frame["time_s"]);
        let (cars, found) = (frame["cars"].as_array().unwrap(), found["cars"].as_array().unwrap());
        assert_eq!(cars.len(), found.len());
        for (car, found) in cars.iter().zip(found) {
            assert_eq!(car["box"], found["bbox_px"]);
            let pairs =
                car["keypoints_px"].as_array().unwrap().iter().zip(found["keypoints"].as_array().unwrap());
            for (truth, found) in pairs {
                assert_eq!(number(&truth[2]) == 1.0, !found.is_null());
                if !found.is_null() {
                    assert_eq!((&truth[0], &truth[1]), (&found[0], &found[1]));
                }
            }
            let position = (number(&car["world_from_car"][0][3]), number(&car["world_from_car"][1][3]));
            observed.push((
                car["id"].as_u64().unwrap(),
                frame["frame"].as_u64().unwrap(),
                position,
                number(&car["speed_mps"]),
            ));
        }
    }
    let mut driven = 0;
    for (id, frame, (x, y), speed) in &observed {
        let next = observed.iter().find(|(i, f, ..)| i == id && *f == frame + 1);
        let Some((_, _, (x1, y1), speed1)) = next else { continue };
        let moved = (x1 - x).hypot(y1 - y) * 5.0;
        assert!((moved - 0.5 * (speed + speed1).abs()).abs() < 0.1, "{moved} {speed} {speed1}");
        driven += usize::from(*speed != 0.0);
    }
    assert!(driven > 8, "{driven}");
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_interrupted_work_continues() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    synth(&one, 7, 1, &[]).code(0);
    synth(&two, 7, 0, &[]).code(0);
    std::fs::remove_file(two.join("scenes/still_0005.truth.json")).unwrap();
    synth(&two, 7, 1, &[]).code(0);
    for file in names(&one.join("scenes")) {
        let read = |set: &Path| std::fs::read(set.join("scenes").join(&file)).unwrap();
        assert_eq!(read(&one), read(&two), "{file}");
    }
    assert_eq!(
        std::fs::read(one.join("dataset.json")).unwrap(),
        std::fs::read(two.join("dataset.json")).unwrap()
    );
    // Items with other options must not be added to the data set.
    let refused = synth(&two, 7, 1, &["--noise", "0.05"]).code(2);
    assert!(String::from_utf8_lossy(&refused.get_output().stderr).contains("other options"));
    synth(&two, 7, 1, &["--noise", "-1"]).code(2);
}
