//! What attention costs: the same clips run with it and without.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roadplane_base::{CarRecord, FrameRecord, bbox_iou};
use roadplane_pipeline::{Cancel, Config, Existing, Progress, RunOptions, Silent, run_input};
use roadplane_write::{FrameReader, WriteError};

use crate::metrics::hota::HotaCounts;
use crate::run::FinishedRun;
use crate::scoring::score_tracks;
use crate::truth::read_truth;
use crate::{Cell, Column, EvalError, Report, Table};

/// Vehicles whose boxes are narrower do not count, px.
const MIN_WIDTH_PX: f64 = 40.0;
/// Boxes that overlap more are of one vehicle, intersection over union.
const SAME: f64 = 0.3;
/// A vehicle found without attention may be without a box for so long, s.
const MAX_MISSING_S: f64 = 0.3;
/// A vehicle that is not found for so long has left, s.
const GAP_S: f64 = 0.3;

/// One way of running a clip.
struct Way {
    run: FinishedRun,
    frames: Vec<FrameRecord>,
}

/// Runs each clip with attention and without, in folders below `work`, and says what became of vehicles, tracks and camera;
/// clips with a truth file beside them (`NAME.truth.json`, gzipped or not) are scored as well.
///
/// # Errors
/// [`EvalError`]: the first clip that cannot be run or read.
pub fn evaluate_attention(
    clips: &[PathBuf],
    models: &Path,
    work: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, EvalError> {
    let columns = [
        ("clip", 0),
        ("vehicles", 0),
        ("missing > 0.3 s", 0),
        ("wavering", 0),
        ("tracks, off", 0),
        ("tracks, on", 0),
        ("focal, px, off", 0),
        ("focal, px, on", 0),
        ("height, m, off", 2),
        ("height, m, on", 2),
        ("HOTA, %, off", 1),
        ("HOTA, %, on", 1),
        ("seen, %", 1),
    ];
    let note = format!(
        "Vehicles: boxes wider than {MIN_WIDTH_PX} px that the run without attention links from frame to frame for more than \
         {GAP_S} s; missing: for longer than {MAX_MISSING_S} s in a row no box of the run with attention overlaps theirs; wavering: \
         those of them that the run without attention, too, finds in no more than half of the frames of that time. Seen: \
         share of the pictures that the detector looked at, over all frames."
    );
    let mut table = Table::new(
        "Attention on against off",
        note,
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    );
    for clip in clips {
        let way = |attention: bool| -> Result<Way, EvalError> {
            let mut config = config.clone();
            config.watch.attention = attention;
            let out = work.join(if attention { "on" } else { "off" });
            let no_folder = |source| WriteError::Io { doing: "make the folder", source, path: out.clone() };
            std::fs::create_dir_all(&out).map_err(no_folder)?;
            let options = RunOptions {
                existing: Existing::Overwrite,
                frames: true,
                ..RunOptions::new(models.to_path_buf())
            };
            let folder = run_input(clip, &out, &options, &config, cancel, &Silent)?.folder;
            let frames = FrameReader::open(&folder.join("frames.jsonl"))?.collect::<Result<_, _>>()?;
            Ok(Way { run: FinishedRun::read(&folder)?, frames })
        };
        let (off, on) = (way(false)?, way(true)?);
        let vehicles = vehicles(&off.frames);
        let found: BTreeMap<u64, &[CarRecord]> =
            on.frames.iter().map(|frame| (frame.frame, frame.cars.as_slice())).collect();
        let times: Vec<f64> = off.frames.iter().map(|frame| frame.time_s).collect();
        let missing: Vec<Gap> = vehicles
            .iter()
            .map(|vehicle| longest_missing(vehicle, &found))
            .filter(|gap| gap.to_s - gap.from_s > MAX_MISSING_S)
            .collect();
        let wavering = missing.iter().filter(|gap| gap.share_found(&times) <= 0.5).count();
        let tracks = |way: &Way| {
            let mut tracks: Vec<u64> = way.run.rows.iter().map(|row| row.track).collect();
            tracks.sort_unstable();
            tracks.dedup();
            tracks.len() as f64
        };
        let truth = ["truth.json.gz", "truth.json"].map(|end| clip.with_extension(end));
        let truth = truth.iter().find(|path| path.is_file()).map(|path| read_truth(path)).transpose()?;
        let hota = |way: &Way| {
            truth.as_ref().map_or(f64::NAN, |truth| {
                let analysed = way.run.analysed(truth);
                let score = score_tracks(truth, &way.run.rows, |frame, _| analysed.contains(&frame));
                100.0 * HotaCounts::of(&score.sequence).score().hota
            })
        };
        let seen = |way: &Way| {
            let shares = way.frames.iter().filter_map(|frame| frame.watch.as_ref()?.seen);
            100.0 * shares.sum::<f64>() / way.frames.len().max(1) as f64
        };
        let numbers = [
            vehicles.len() as f64,
            missing.len() as f64,
            wavering as f64,
            tracks(&off),
            tracks(&on),
            off.run.camera.focal_px,
            on.run.camera.focal_px,
            off.run.camera.height_m,
            on.run.camera.height_m,
            hota(&off),
            hota(&on),
            seen(&on),
        ];
        let name = clip.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        table.rows.push(std::iter::once(Cell::from(name)).chain(numbers.map(Cell::from)).collect());
        progress.frame_done();
    }
    Ok(Report { title: "Attention".to_owned(), tables: vec![table], ..Report::default() })
}

/// A vehicle's boxes: frame, time (s), box.
type Boxes = Vec<(u64, f64, [f64; 4])>;

/// Links boxes from frame to frame by overlap, and keeps vehicles that are wide and seen long enough.
fn vehicles(frames: &[FrameRecord]) -> Vec<Boxes> {
    let mut done: Vec<Boxes> = Vec::new();
    let mut open: Vec<Boxes> = Vec::new();
    for frame in frames {
        let is_open = |boxes: &Boxes| boxes.last().is_some_and(|last| frame.time_s - last.1 <= GAP_S);
        let (kept, left): (Vec<Boxes>, Vec<Boxes>) = open.into_iter().partition(is_open);
        done.extend(left);
        open = kept;
        let mut taken = vec![false; open.len()];
        for car in &frame.cars {
            let overlap = |boxes: &Boxes| boxes.last().map_or(0.0, |last| bbox_iou(&last.2, &car.bbox_px));
            let best = (0..taken.len())
                .filter(|&i| !taken[i] && overlap(&open[i]) >= SAME)
                .max_by(|&a, &b| overlap(&open[a]).total_cmp(&overlap(&open[b])));
            let entry = (frame.frame, frame.time_s, car.bbox_px);
            match best {
                Some(i) => {
                    taken[i] = true;
                    open[i].push(entry);
                }
                None => open.push(vec![entry]),
            }
        }
    }
    done.extend(open);
    for boxes in &mut done {
        boxes.retain(|(_, _, [x0, _, x1, _])| x1 - x0 > MIN_WIDTH_PX);
    }
    done.retain(|boxes| match (boxes.first(), boxes.last()) {
        (Some(first), Some(last)) => last.1 - first.1 > GAP_S,
        _ => false,
    });
    done
}

/// A time in which a vehicle is missing.
#[derive(Clone, Copy, Debug, Default)]
struct Gap {
    from_s: f64,
    to_s: f64,
    /// Its boxes after `from_s`, up to `to_s`.
    boxes: usize,
}

impl Gap {
    /// Share of the frames at these times in which the vehicle has a box nevertheless.
    fn share_found(&self, times_s: &[f64]) -> f64 {
        let frames = times_s.iter().filter(|&&time_s| time_s > self.from_s && time_s <= self.to_s).count();
        self.boxes as f64 / frames.max(1) as f64
    }
}

/// Longest time in which none of the boxes found overlaps the vehicle's.
fn longest_missing(vehicle: &Boxes, found: &BTreeMap<u64, &[CarRecord]>) -> Gap {
    let mut longest = Gap::default();
    let from_s = vehicle.first().map_or(0.0, |first| first.1);
    let mut open = Gap { from_s, to_s: from_s, boxes: 0 };
    for (frame, time_s, bbox) in vehicle {
        let here = found.get(frame).copied().unwrap_or_default();
        if here.iter().any(|car| bbox_iou(&car.bbox_px, bbox) >= SAME) {
            open = Gap { from_s: *time_s, to_s: *time_s, boxes: 0 };
        } else {
            open = Gap { to_s: *time_s, boxes: open.boxes + 1, ..open };
        }
        if open.to_s - open.from_s > longest.to_s - longest.from_s {
            longest = open;
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::ImageSize;

    fn frames(count: u64, here: impl Fn(u64) -> bool) -> Vec<FrameRecord> {
        let size = ImageSize { width: 640, height: 360 };
        (0..count)
            .map(|i| {
                let x = i as f64 * 4.0;
                let cars = here(i).then(|| CarRecord::boxed([x, 100.0, x + 80.0, 150.0]));
                FrameRecord {
                    cars: cars.into_iter().collect(),
                    ..FrameRecord::empty(i, i as f64 * 0.04, size)
                }
            })
            .collect()
    }

    #[test]
    fn a_vehicle_is_missing_where_no_box_is() {
        let vehicles = vehicles(&frames(50, |_| true));
        assert_eq!((vehicles.len(), vehicles[0].len()), (1, 50));
        let missing = |here: fn(u64) -> bool| {
            let on = frames(50, here);
            let gap =
                longest_missing(&vehicles[0], &on.iter().map(|f| (f.frame, f.cars.as_slice())).collect());
            gap.to_s - gap.from_s
        };
        assert!(missing(|i| i % 3 == 0) < 0.1);
        assert!((missing(|i| !(20..30).contains(&i)) - 0.4).abs() < 1e-9);
        assert!((missing(|_| false) - 49.0 * 0.04).abs() < 1e-9);
    }

    #[test]
    fn a_vehicle_that_is_seldom_found_wavers() {
        let off = frames(50, |i| i % 3 == 0);
        let vehicles = vehicles(&off);
        let times: Vec<f64> = off.iter().map(|frame| frame.time_s).collect();
        let on = frames(50, |i| i == 0);
        let gap = longest_missing(&vehicles[0], &on.iter().map(|f| (f.frame, f.cars.as_slice())).collect());
        assert!((gap.share_found(&times) - 1.0 / 3.0).abs() < 1e-9, "{gap:?}");
    }
}
