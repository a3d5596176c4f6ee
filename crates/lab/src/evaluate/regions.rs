//! Compares runs with and without region-of-interest (ROI) scheduling on the same clips.

mod scores;
mod vehicles;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roadplane_base::{CarRecord, FrameRecord, ShapeAtlas};
use roadplane_pipeline::{Cancel, Config, Existing, PipelineError, Progress, RunOptions, Silent, run_input};
use roadplane_write::{FrameReader, WriteError};

use crate::LabError;
use crate::finished_run::{FinishedRun, track_count};
use roadplane_metrics::truth::read_truth;
use roadplane_tables::{Cell, Column, Report, Table};
use scores::ClipScore;
use vehicles::{GAP_S, Gap, MIN_WIDTH_PX, longest_missing, vehicles};

/// Longest time for which the run with ROI scheduling may miss a vehicle, s.
///
/// The run without ROI scheduling defines the vehicles.
const MAX_MISSING_S: f64 = 0.3;

/// One run of a clip.
struct ClipRun {
    run: FinishedRun,
    frames: Vec<FrameRecord>,
}

/// Runs each clip with and without ROI scheduling, and compares the vehicles, tracks and cameras of the two runs.
///
/// The results go into subfolders of `work`.
///
/// Clips with a truth file beside them (`NAME.truth.json`, gzipped or not) are also scored against the truth.
///
/// # Errors
/// [`LabError`] for the first clip that cannot be run or read.
pub fn evaluate_regions(
    clips: &[PathBuf],
    models: &Path,
    work: &Path,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
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
        ("HOTA fitted, %, off", 1),
        ("HOTA fitted, %, on", 1),
        ("processed, %", 1),
    ];
    let note = format!(
        "Off: without region-of-interest scheduling; on: with it. Vehicles: boxes wider than {MIN_WIDTH_PX} px that \
         the run without scheduling links from frame to frame for more than {GAP_S} s. Missing: for longer than \
         {MAX_MISSING_S} s, no box of the run with scheduling overlaps the vehicle. Wavering: missing vehicles that \
         even the run without scheduling finds in at most half of the frames of that time. Processed: share of the pictures that the detector processed, \
         over all frames."
    );
    let mut table = Table::new(
        "Region-of-interest scheduling, on against off",
        note,
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    );
    let columns = [
        ("clip", 0),
        ("from, s", 2),
        ("to, s", 2),
        ("left, px", 0),
        ("top, px", 0),
        ("width, px", 0),
        ("highest score, off", 2),
        ("found, off, % of the frames", 0),
    ];
    let mut lost = Table::new(
        "Vehicles missing with region-of-interest scheduling",
        "Position of the first missing box, and the highest score, in the run without scheduling (off).",
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    );
    let atlas = ShapeAtlas::shipped().map_err(PipelineError::from)?;
    let mut scored: Vec<[ClipScore; 2]> = Vec::new();
    for clip in clips {
        let name = clip.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let run = |scheduled: bool| -> Result<ClipRun, LabError> {
            let mut config = config.clone();
            config.watch.attention = scheduled;
            let out = work.join(if scheduled { "on" } else { "off" });
            let no_folder = |source| WriteError::Io { doing: "make the folder", source, path: out.clone() };
            std::fs::create_dir_all(&out).map_err(no_folder)?;
            let options = RunOptions {
                existing: Existing::Overwrite,
                frames: true,
                ..RunOptions::new(models.to_path_buf())
            };
            let folder = run_input(clip, &out, &options, &config, cancel, &Silent)?.folder;
            let frames = FrameReader::open(&folder.join("frames.jsonl"))?.collect::<Result<_, _>>()?;
            Ok(ClipRun { run: FinishedRun::read(&folder)?, frames })
        };
        let (off, on) = (run(false)?, run(true)?);
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
        let truth = ["truth.json.gz", "truth.json"].map(|end| clip.with_extension(end));
        let truth = truth.iter().find(|path| path.is_file()).map(|path| read_truth(path)).transpose()?;
        let score =
            truth.as_ref().map(|truth| [&off, &on].map(|clip| ClipScore::of(&clip.run, truth, &atlas)));
        let of_score =
            |of: fn(&ClipScore) -> f64| score.as_ref().map_or([f64::NAN; 2], |[off, on]| [of(off), of(on)]);
        let ([hota_off, hota_on], [fitted_off, fitted_on]) =
            (of_score(ClipScore::hota), of_score(ClipScore::fitted_hota));
        let processed = |clip: &ClipRun| {
            let shares = clip.frames.iter().filter_map(|frame| frame.watch.as_ref()?.seen);
            100.0 * shares.sum::<f64>() / clip.frames.len().max(1) as f64
        };
        let numbers = [
            vehicles.len() as f64,
            missing.len() as f64,
            wavering as f64,
            track_count(&off.run.rows) as f64,
            track_count(&on.run.rows) as f64,
            off.run.camera.focal_px,
            on.run.camera.focal_px,
            off.run.camera.height_m,
            on.run.camera.height_m,
            hota_off,
            hota_on,
            fitted_off,
            fitted_on,
            processed(&on),
        ];
        for gap in &missing {
            let [x0, y0, x1, _] = gap.bbox_px;
            let share = 100.0 * gap.share_found(&times);
            let numbers = [gap.from_s, gap.to_s, x0, y0, x1 - x0, gap.score, share].map(Cell::from);
            lost.rows.push(std::iter::once(Cell::from(name.as_str())).chain(numbers).collect());
        }
        scored.extend(score);
        table.rows.push(std::iter::once(Cell::from(name)).chain(numbers.map(Cell::from)).collect());
        progress.frame_done();
    }
    let against_truth = (!scored.is_empty()).then(|| scores::table(&scored));
    let tables = [table, lost].into_iter().chain(against_truth).collect();
    Ok(Report { title: "Region-of-interest scheduling".to_owned(), tables, ..Report::default() })
}
