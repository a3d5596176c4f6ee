//! Measures the cost of the keypoint net: `cargo run --release -p roadplane-keypoints --example speed --
//! [auto|cpu|int8|openvino]`.
//!
//! The program prints the CPU time per crop, at a batch size of 8. It is the time of the whole process, with all
//! threads of the provider, although one thread is requested. The printed time is the median of several runs. The
//! number of GFLOP comes from the net's card.

use std::path::Path;

use ndarray::Array4;
use roadplane_infer::{NamedTensor, ProviderChoice, Session, SessionOptions};

const BATCH: usize = 8;
const RUNS: usize = 25;

/// Returns the CPU time of this process so far, s.
fn cpu_seconds() -> Result<f64, Box<dyn std::error::Error>> {
    let mut total = 0.0;
    for task in std::fs::read_dir("/proc/self/task")? {
        let text = std::fs::read_to_string(task?.path().join("schedstat"))?;
        total += text.split_whitespace().next().unwrap_or("0").parse::<f64>()? * 1e-9;
    }
    Ok(total)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let provider = match std::env::args().nth(1).as_deref() {
        None | Some("cpu") => ProviderChoice::Cpu,
        Some("auto") => ProviderChoice::Auto,
        Some("int8") => ProviderChoice::Int8,
        Some("openvino") => ProviderChoice::Openvino,
        Some(other) => return Err(format!("no provider {other}: auto, cpu, int8 or openvino").into()),
    };
    let card = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/hourglass.card.json");
    let mut session = Session::open(&card, &SessionOptions { provider, threads: 1, library: None })?;
    let side = roadplane_keypoints::CROP_PX;
    let crops = Array4::from_shape_fn((BATCH, 3, side, side), |(b, c, y, x)| {
        ((b * 7 + c * 5 + y * 3 + x) % 256) as f32 / 255.0
    });
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let begin = cpu_seconds()?;
        session.run(&[NamedTensor { name: "image", values: crops.view().into_dyn() }])?;
        times.push((cpu_seconds()? - begin) / BATCH as f64);
    }
    times.sort_by(f64::total_cmp);
    let seconds = times[RUNS / 2];
    let how_made = session.card().extra.get("how_made");
    let gflop = how_made.and_then(|made| made.get("gflop_per_crop")).and_then(serde_json::Value::as_f64);
    print!("{}: {:.2} ms a crop", session.provider(), 1e3 * seconds);
    match gflop {
        Some(gflop) => println!(", {gflop} GFLOP a crop, {:.0} GFLOP/s", gflop / seconds),
        None => println!(" (the card states no GFLOP)"),
    }
    Ok(())
}
