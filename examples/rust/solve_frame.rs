//! Solves the camera and the cars of one frame from keypoints alone, without video and nets.
//!
//! `cargo run --release -p roadplane-pipeline --example solve_frame -- RUN/frames.jsonl`
//!
//! The command `roadplane run --frames` writes the file `frames.jsonl`. Any other program may write such a file, too.
//! The command `roadplane schemas frames` prints its schema.

use std::error::Error;
use std::path::PathBuf;

use roadplane_base::{FrameRecord, KeypointSet, ShapeAtlas};
use roadplane_pipeline::Config;
use roadplane_solve::{CarView, solve_scene};
use roadplane_write::read_jsonl;

/// Returns the keypoints of each car in a frame. Cars without keypoints are left out, and so are keypoints with a score
/// below `min_score`.
fn keypoints(frame: &FrameRecord, min_score: f64) -> Vec<KeypointSet> {
    let sets = frame.cars.iter().filter_map(|car| car.keypoints.as_deref());
    sets.map(|set| set.map(|point| point.filter(|point| point.score >= min_score))).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = PathBuf::from(std::env::args().nth(1).ok_or("usage: solve_frame RUN/frames.jsonl")?);
    let config = Config::default();

    // The frame with the most cars constrains the camera best.
    let mut best: Option<(FrameRecord, Vec<KeypointSet>)> = None;
    for frame in read_jsonl::<FrameRecord>(&path)? {
        let frame = frame?;
        let sets = keypoints(&frame, config.solve.min_keypoint_score);
        if best.as_ref().is_none_or(|(_, most)| sets.len() > most.len()) {
            best = Some((frame, sets));
        }
    }
    let (frame, sets) = best.ok_or("the file has no frames")?;

    // All views come from one frame, so each view belongs to another car.
    let views = CarView::each(&sets);
    let atlas = ShapeAtlas::shipped()?;
    let solution = solve_scene(&atlas, frame.image_size_px, &views, &config.solve.scene_options(None));

    // The covariance is that of (log focal length, tilt, roll, log height). The sd of a logarithm is a relative sd.
    let sd = solution.covariance.diagonal().map(f64::sqrt);
    let params = solution.params;
    let height_m = params.log_height.exp();
    println!("frame {}, {} cars: {:?}", frame.frame, views.len(), solution.status);
    println!("focal length {:.0} ± {:.0} px", params.focal_px(), params.focal_px() * sd[0]);
    println!("tilt {:.1} ± {:.1} degrees", params.tilt.to_degrees(), sd[1].to_degrees());
    println!("height {height_m:.1} ± {:.1} m", height_m * sd[3]);
    for (index, car) in solution.cars.iter().enumerate() {
        match car {
            Some(car) => println!("car {index}: x {:.1} m, y {:.1} m", car.ground.x_m, car.ground.y_m),
            None => println!("car {index}: rejected"),
        }
    }
    Ok(())
}
