//! Prints the watcher's verdicts on a clip.
//!
//! Usage: `cargo run --release -p roadplane-watch --example verdicts -- CLIP [STRIDE]`
//!
//! A line is printed whenever the verdict changes or the camera moves. At the end, a summary of shake and change is
//! printed.

use roadplane_decode::{DecodeOptions, open};
use roadplane_watch::{ChangeMap, Watcher};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: verdicts CLIP [STRIDE]")?;
    let stride = arguments.next().map_or(Ok(1), |s| s.parse())?;
    let mut input = open(path.as_ref(), &DecodeOptions { stride, ..DecodeOptions::default() })?;
    let mut watcher = Watcher::new();
    let mut map: Option<ChangeMap> = None;
    let mut keyframe = None;
    let (mut last, mut shares, mut furthest, mut busy_s) = (None, Vec::new(), 0.0_f64, 0.0);
    while let Some(frame) = input.next_frame()? {
        let started = std::time::Instant::now();
        let seen = watcher.observe(frame.stamp, &frame.image)?;
        if seen.view.map(|view| view.keyframe) != keyframe {
            (keyframe, map) = (seen.view.map(|view| view.keyframe), None);
        }
        let map = map.get_or_insert_with(|| ChangeMap::new(&seen.small));
        let changed = match &seen.view {
            Some(view) => {
                let changed = map.changed(&seen.small, view, frame.stamp.time_s());
                map.mark_inspected(&changed, &changed);
                changed
            }
            None => map.all_cells(),
        };
        busy_s += started.elapsed().as_secs_f64();
        shares.push(changed.share());
        let record = &seen.record;
        furthest = furthest.max(record.offset().norm());
        if last != Some(record.verdict) || record.moved.is_some() {
            println!(
                "frame {} {:.2} s: {:?} {:?}",
                frame.stamp.index,
                frame.stamp.time_s(),
                record.verdict,
                record.moved
            );
        }
        last = Some(record.verdict);
    }
    let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
    println!(
        "{} frames, {:.2} ms each, farthest {furthest:.2} px from rest, {:.1} % of cells changed",
        shares.len(),
        busy_s / shares.len().max(1) as f64 * 1e3,
        mean * 100.0
    );
    Ok(())
}
