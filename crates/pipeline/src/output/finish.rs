//! The right half of a run into its partial folder: what the frames tell, written and drawn.

use std::path::Path;
use std::time::Instant;

use roadplane_activity::ActivityNet;
use roadplane_base::ShapeAtlas;
use roadplane_export::{Run, write_ways};
use roadplane_write::{
    RunStatus, StageSeconds, Summary, rounded_row, write_camera, write_evidence, write_json, write_summary,
};

use crate::cameras::memory::EVIDENCE;
use crate::cameras::witnesses::SceneView;
use crate::estimation::{ClipSolution, Given, solve_constrained_clip};
use crate::identity::{peak_memory_bytes, versions};
use crate::output::draw::{ReportPictures, draw_video, write_report};
use crate::output::track_rows::{ShownRows, TrackRows};
use crate::stream::perception::{Job, Left, SPOOL};
use crate::stream::speed::Meter;
use crate::{Config, PipelineError, Silent};

/// What the right half begins with.
pub(crate) struct Finish<'a> {
    /// The partial folder with its spool.
    pub folder: &'a Path,
    /// The result's name.
    pub stem: &'a str,
    /// What the left half left.
    pub left: &'a Left,
    /// Tells what tracks do.
    pub activity: Option<ActivityNet>,
    /// When the work began.
    pub started: Instant,
    /// Counts what it costs.
    pub meter: Option<Meter>,
}

/// Solves the clip and writes all files of its result.
pub(crate) fn finish(work: Finish<'_>, job: &Job<'_>) -> Result<ClipSolution, PipelineError> {
    let &Job { options, config, cancel, progress } = job;
    let Finish { folder, stem, left, activity, started, mut meter } = work;
    let input = Path::new(&left.input.path);
    let place = left.place.as_ref();
    let atlas = ShapeAtlas::shipped()?;
    let recall = options
        .cameras
        .as_ref()
        .map(|memory| memory.recall(input, &left.input, left.fingerprints.clone(), place))
        .transpose()?;
    progress.phase("solving");
    let solving = Instant::now();
    let (spool, poses) = (folder.join(SPOOL), folder.join("poses.jsonl"));
    let given = Given { recall: recall.as_ref(), site: options.site.as_ref(), ..Given::new(&options.known) };
    let drawn = left.samples.iter().map(|(frame, ..)| *frame).chain(left.stills.crop_frames());
    let mut rows = TrackRows::new(folder, activity, ShownRows::of(drawn.collect()));
    let mut solution = solve_constrained_clip(&spool, &poses, &atlas, &given, &mut rows, config, cancel)?;
    let shown = rows.finish()?;
    let is_thinned = shown.is_thinned();
    solution.rows = shown.rows;
    let solve_s = solving.elapsed().as_secs_f64();
    if let Some(meter) = &mut meter {
        meter.solved();
    }
    progress.phase("writing");
    write_camera_and_place(folder, &solution)?;
    if let Some(said) = solution.cameras.said() {
        write_evidence(&folder.join(EVIDENCE), said)?;
    }
    let mut summary = summary_of(left, &solution, config);
    summary.seconds.push(StageSeconds { stage: "solve".to_owned(), seconds: solve_s });
    summary.wall_s = started.elapsed().as_secs_f64();
    summary.frames_per_s = left.decode.delivered as f64 / summary.wall_s.max(1e-9);
    summary.peak_memory_bytes = peak_memory_bytes();
    summary.speed = meter.as_mut().map(Meter::speed);
    let report = folder.join("report.html");
    let seen = ReportPictures { samples: &left.samples, stills: &left.stills, background: place, is_thinned };
    write_report(&report, stem, &atlas, &solution, &seen, &summary, config)?;
    // The report cannot tell what it costs itself.
    summary.speed = meter.as_mut().map(Meter::speed);
    if options.video {
        progress.phase("drawing");
        let (told, video) = ((&solution.cameras, &solution.shapes), folder.join("annotated.mp4"));
        draw_video(input, folder, told, &video, config, cancel, &Silent)?;
    }
    write_summary(&folder.join("summary.json"), &summary)?;
    if solution.place.is_some() {
        // Of long clips as many rows as the report shows.
        let rows = std::mem::take(&mut solution.rows);
        write_ways(
            &Run::with_rows(folder, stem, rows.iter().map(rounded_row).map(Ok))?,
            &folder.join("tracks.geojson"),
        )?;
    }
    Ok(solution)
}

fn summary_of(left: &Left, solution: &ClipSolution, config: &Config) -> Summary {
    let decode = &left.decode;
    let mut summary = Summary {
        status: if decode.is_damaged() { RunStatus::InputDamaged } else { RunStatus::Complete },
        exit_code: if decode.is_damaged() { 3 } else { 0 },
        versions: versions(),
        input: left.input.clone(),
        models: left.models.clone(),
        config: serde_json::to_value(config).unwrap_or_default(),
        config_sha256: config.fingerprint(),
        watch: left.watch.clone(),
        seconds: left.seconds.clone(),
        warnings: decode.warnings.clone(),
        ..Summary::default()
    };
    let counts = &mut summary.counts;
    counts.frames_expected = Some(decode.expected);
    counts.frames_read = decode.decoded;
    counts.frames_lost = decode.missing;
    counts.frames_skipped = decode.decoded.saturating_sub(decode.delivered);
    if decode.missing > 0 {
        let (lost, places) = (decode.missing, decode.damaged_stretch_count);
        summary.warnings.push(format!("{lost} frames in {places} places could not be decoded"));
    }
    note_solution(&mut summary, solution);
    if left.rejected_cars > 0 {
        summary.counts.rejected.insert("keypoints_not_finite".to_owned(), left.rejected_cars);
    }
    summary
}

/// Counts and warnings of a solved clip.
pub fn note_solution(summary: &mut Summary, solution: &ClipSolution) {
    let counts = &mut summary.counts;
    counts.boxes = solution.tally.boxes.clone();
    counts.rejected = solution.tally.rejected.clone();
    counts.poses_used = solution.poses_used;
    counts.tracks = solution.shapes.len() as u64;
    counts.track_rows = solution.row_count;
    summary.known = solution.cameras.known().to_vec();
    summary.scene_lines = solution.cameras.scene().iter().map(SceneView::summary).collect();
    summary.warnings.extend(solution.warnings.iter().cloned());
}

/// `camera.json`, and `place.json` where the camera's place is known.
pub(crate) fn write_camera_and_place(folder: &Path, solution: &ClipSolution) -> Result<(), PipelineError> {
    write_camera(&folder.join("camera.json"), solution.cameras.estimates())?;
    if let Some(place) = &solution.place {
        write_json(&folder.join("place.json"), &place.fit)?;
    }
    Ok(())
}
