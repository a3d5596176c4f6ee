//! Second half of a run: estimates the camera and the tracks from the frames, and writes all files of the result.

use std::path::Path;
use std::time::Instant;

use image::RgbImage;
use roadplane_activity::ActivityNet;
use roadplane_base::ShapeAtlas;
use roadplane_calibrate::SceneView;
use roadplane_export::{Run, write_paths};
use roadplane_view::RoadPicture;
use roadplane_write::{
    RunStatus, SceneLinesSummary, StageSeconds, Summary, rounded_row, write_camera, write_evidence,
    write_json, write_summary,
};

use crate::cameras::database::EVIDENCE;
use crate::estimation::{ClipSolution, Given, solve_constrained_clip};
use crate::identity::{peak_memory_bytes, versions};
use crate::output::draw::{Drawn, ReportParts, draw_video, write_report};
use crate::output::track_rows::{ShownRows, TrackRows};
use crate::stream::perception::{Job, Perceived, SPOOL};
use crate::stream::speed::Meter;
use crate::traffic::{traffic_of_run, traffic_sections, write_traffic};
use crate::{Config, PipelineError, Silent};

/// Inputs of [`finish`].
pub(crate) struct Finish<'a> {
    /// Folder of the unfinished result. It already contains the file of frames.
    pub folder: &'a Path,
    /// Name of the result.
    pub stem: &'a str,
    /// The results of perception other than the file of frames.
    pub perceived: &'a Perceived,
    /// Net that labels the activities of tracks; `None` if activities are switched off.
    pub activity: Option<ActivityNet>,
    /// Time when the run started.
    pub started: Instant,
    /// Meter of the run's processor time; `None` when pieces of an input are joined.
    pub meter: Option<Meter>,
}

/// Estimates the camera and the tracks of a clip, and writes all files of its result.
pub(crate) fn finish(work: Finish<'_>, job: &Job<'_>) -> Result<ClipSolution, PipelineError> {
    let &Job { options, config, cancel, progress } = job;
    let Finish { folder, stem, perceived, activity, started, mut meter } = work;
    let input = Path::new(&perceived.input.path);
    let background = perceived.background.as_ref();
    let atlas = ShapeAtlas::shipped()?;
    let history = options
        .cameras
        .as_ref()
        .map(|database| {
            let Perceived { input, recorded, fingerprints, .. } = perceived;
            database.history_of(input, recorded, fingerprints.clone(), background)
        })
        .transpose()?
        .flatten();
    progress.phase("solving");
    let solving = Instant::now();
    let (spool, poses) = (folder.join(SPOOL), folder.join("poses.jsonl"));
    let site = options.site.as_ref();
    let empty_scene = background.and_then(|scene| scene.registration.as_ref());
    let given = Given { history: history.as_ref(), site, empty_scene, ..Given::new(&options.constraints) };
    let drawn = perceived.samples.iter().map(|(frame, ..)| *frame).chain(perceived.stills.crop_frames());
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
    if let Some(evidence) = &solution.cameras.evidence {
        write_evidence(&folder.join(EVIDENCE), evidence)?;
    }
    let mut summary = summary_of(perceived, &solution, config);
    summary.warnings.extend(options.cameras.as_ref().and_then(|database| database.warning_of(input)));
    summary.seconds.push(StageSeconds { stage: "solve".to_owned(), seconds: solve_s });
    summary.wall_s = started.elapsed().as_secs_f64();
    summary.frames_per_s = perceived.decode.delivered as f64 / summary.wall_s.max(1e-9);
    summary.peak_memory_bytes = peak_memory_bytes();
    summary.speed = meter.as_mut().map(Meter::speed);
    let report = folder.join("report.html");
    let run = TrafficRun { folder, stem, config };
    let sections = config
        .traffic
        .enabled
        .then(|| run_traffic(&run, road_picture(perceived, &solution).as_ref(), &mut summary));
    let sections = sections.unwrap_or_default();
    let pictures = ReportParts {
        traffic: &sections,
        samples: &perceived.samples,
        stills: &perceived.stills,
        background: background.map(|scene| &scene.picture),
        is_thinned,
    };
    write_report(&report, stem, &atlas, &solution, &pictures, &summary, config)?;
    // Unlike the report, the summary includes the cost of writing the report.
    summary.speed = meter.as_mut().map(Meter::speed);
    if options.video {
        progress.phase("drawing");
        let (drawn, video) = (
            Drawn { cameras: &solution.cameras, views: &solution.views, shapes: &solution.shapes },
            folder.join("annotated.mp4"),
        );
        draw_video(input, folder, drawn, &video, config, cancel, &Silent)?;
    }
    write_summary(&folder.join("summary.json"), &summary)?;
    if solution.place.is_some() {
        // For a long clip, the file has only the rows that the report shows.
        let rows = std::mem::take(&mut solution.rows);
        write_paths(
            &Run::with_rows(folder, stem, rows.iter().map(rounded_row).map(Ok))?,
            &folder.join("tracks.geojson"),
        )?;
    }
    Ok(solution)
}

/// A run whose tables of traffic are written: its folder, its name and its settings.
struct TrafficRun<'a> {
    folder: &'a Path,
    stem: &'a str,
    config: &'a Config,
}

/// Returns a frame that shows the first position of the camera, with its camera.
fn road_picture<'a>(perceived: &'a Perceived, solution: &'a ClipSolution) -> Option<RoadPicture<'a>> {
    let is_first = |(_, time_s, _): &&(u64, f64, RgbImage)| solution.cameras.position_at(*time_s) == 0;
    let (frame, time_s, picture) = perceived.samples.iter().find(is_first)?;
    Some(RoadPicture {
        picture,
        camera: solution.cameras.at(*time_s)?,
        picture_from_world: solution.views.of(*frame),
    })
}

/// Computes and writes the tables of traffic into the folder `traffic` of a result, and returns the sections of the
/// report. A fault becomes a warning, so that the tracks are not lost.
fn run_traffic(run: &TrafficRun<'_>, road: Option<&RoadPicture<'_>>, summary: &mut Summary) -> String {
    let &TrafficRun { folder, stem, config } = run;
    let tables = folder.join("traffic");
    let sections = traffic_of_run(folder, stem, summary, &config.traffic).and_then(|mut report| {
        let sections = traffic_sections(&report, road)?;
        std::fs::create_dir_all(&tables)
            .map_err(|source| PipelineError::Unreadable { source, path: tables.clone() })?;
        write_traffic(&mut report, &tables)?;
        Ok((sections, std::mem::take(&mut report.file.warnings)))
    });
    let (sections, warnings) = sections.unwrap_or_else(|error| {
        // Some of the tables may be written.
        std::fs::remove_dir_all(&tables).ok();
        (String::new(), vec![format!("no tables of traffic: {error}")])
    });
    warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    summary.warnings.extend(warnings);
    sections
}

fn summary_of(perceived: &Perceived, solution: &ClipSolution, config: &Config) -> Summary {
    let decode = &perceived.decode;
    let mut summary = Summary {
        status: if decode.is_damaged() { RunStatus::InputDamaged } else { RunStatus::Complete },
        versions: versions(),
        input: perceived.input.clone(),
        models: perceived.models.clone(),
        config: serde_json::to_value(config).unwrap_or_default(),
        config_sha256: config.fingerprint(),
        watch: perceived.watch.clone(),
        seconds: perceived.seconds.clone(),
        warnings: decode.warnings.clone(),
        ..Summary::default()
    };
    let counts = &mut summary.counts;
    counts.frames_expected = Some(decode.expected);
    counts.frames_read = decode.decoded;
    counts.frames_lost = decode.missing;
    counts.frames_skipped = decode.decoded.saturating_sub(decode.delivered);
    summary.warnings.extend(decode.damage_in_words());
    note_solution(&mut summary, solution);
    if perceived.rejected_cars > 0 {
        summary.counts.rejected.insert("keypoints_not_finite".to_owned(), perceived.rejected_cars);
    }
    summary
}

/// Adds the results of estimation to a summary: status, counts, warnings, user constraints and lines of the scene.
pub fn note_solution(summary: &mut Summary, solution: &ClipSolution) {
    let counts = &mut summary.counts;
    counts.boxes = solution.tally.boxes.clone();
    counts.rejected = solution.tally.rejected.clone();
    counts.poses_used = solution.poses_used;
    counts.tracks = solution.shapes.len() as u64;
    counts.tracks_left_out = solution.tally.left_out_tracks;
    counts.track_rows = solution.row_count;
    summary.watch.time_sd_s = solution.time_sd_s;
    summary.status = solution.status(summary.status == RunStatus::InputDamaged);
    summary.exit_code = if summary.status == RunStatus::Complete { 0 } else { 3 };
    solution.not_followed.note(summary);
    summary.known = solution.cameras.constraints.clone();
    summary.scene_lines = solution.cameras.scene.iter().map(lines_summary).collect();
    summary.warnings.extend(solution.warnings.iter().cloned());
}

/// Writes `camera.json` and, if the camera has a position on the map, `place.json`.
pub(crate) fn write_camera_and_place(folder: &Path, solution: &ClipSolution) -> Result<(), PipelineError> {
    write_camera(&folder.join("camera.json"), &solution.cameras.estimates, solution.views.to_file())?;
    if let Some(place) = &solution.place {
        write_json(&folder.join("place.json"), &place.fit)?;
    }
    Ok(())
}

/// Returns the entry of `summary.json` for the cues of one camera position.
fn lines_summary(view: &SceneView) -> SceneLinesSummary {
    let upright = view.verticals.iter().flat_map(|found| &found.upright).filter(|upright| **upright);
    let rounded = |value: f64| (10.0 * value).round() / 10.0;
    SceneLinesSummary {
        segment: view.position,
        found: view.lines.len(),
        upright: upright.count(),
        gain: view.verticals.as_ref().map(|found| rounded(found.gain)),
        turn_focal_px: view.turns.map(|found| rounded(found.focal_px)),
        turn_focal_sd_px: view.turns.map(|found| rounded(found.focal_px * found.log_sd)),
    }
}
