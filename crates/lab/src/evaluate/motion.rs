//! Compares runs on clips of a moving camera with runs on the same clips at rest.

mod compare;
mod film;
mod registrations;
mod turned;

use std::path::{Path, PathBuf};

use roadplane_base::bbox_mapped;
use roadplane_pipeline::{
    CameraConstraints, Cancel, Config, Existing, Progress, RunOptions, Silent, run_input,
};
use roadplane_tables::{Cell, Column, Report, Table};
use roadplane_write::{CameraFile, Summary, WriteError, read_camera, read_summary};

use crate::LabError;
use crate::finished_run::{FinishedRun, track_count};
use compare::Rows;
use film::Clip;
pub use film::Motion;

/// Options of [`evaluate_motion`].
#[derive(Clone, Debug)]
pub struct MotionOptions {
    /// Folder of the nets.
    pub models: PathBuf,
    /// Length of the films, s.
    pub seconds: f64,
    /// Focal length of the videos, px; `None`: the estimate of the run at rest.
    pub focal_px: Option<f64>,
    /// Whether all runs on films get the focal length as a user constraint.
    pub is_focal_given: bool,
    /// Whether the videos are mirrored.
    pub mirrored: bool,
    /// Motions with which videos are filmed.
    pub motions: Vec<Motion>,
    /// Distortion of the films' lens at half their width ([`roadplane_base::Lens::distortion`]).
    pub distortion: f64,
}

/// A finished run with all that the tables need.
struct Run {
    finished: FinishedRun,
    camera: CameraFile,
    summary: Summary,
    /// The file of frames.
    frames: PathBuf,
}

impl Run {
    /// Returns the processor time per frame, ms.
    fn cpu_ms(&self) -> f64 {
        self.summary.speed.as_ref().map_or(f64::NAN, |speed| speed.cpu_ms_per_frame.total)
    }

    /// Returns the focal length from turns of the camera and its sd, px.
    fn turn_focal_px(&self) -> [f64; 2] {
        let of = |lines: &roadplane_write::SceneLinesSummary| {
            Some([lines.turn_focal_px?, lines.turn_focal_sd_px?])
        };
        self.summary.scene_lines.iter().find_map(of).unwrap_or([f64::NAN; 2])
    }
}

/// Runs clips in folders of one working folder.
struct Runner<'a> {
    work: &'a Path,
    models: &'a Path,
    config: &'a Config,
    cancel: &'a Cancel,
}

impl Runner<'_> {
    /// Makes a subfolder of the working folder.
    fn folder(&self, name: &str) -> Result<PathBuf, LabError> {
        let path = self.work.join(name);
        let no_folder = |source| WriteError::Io { doing: "make the folder", source, path: path.clone() };
        std::fs::create_dir_all(&path).map_err(no_folder)?;
        Ok(path)
    }

    /// Runs a clip; the result goes into the subfolder `runs`, or `full` without region-of-interest scheduling.
    fn run(&self, clip: &Path, focal_px: Option<f64>, scheduled: bool) -> Result<Run, LabError> {
        let mut config = self.config.clone();
        config.watch.attention &= scheduled;
        let options = RunOptions {
            existing: Existing::Overwrite,
            constraints: CameraConstraints::focal(focal_px),
            alone: true,
            frames: true,
            ..RunOptions::new(self.models.to_path_buf())
        };
        let out = self.folder(if scheduled { "runs" } else { "full" })?;
        let folder = run_input(clip, &out, &options, &config, self.cancel, &Silent)?.folder;
        let summary = read_summary(&folder.join("summary.json"))?;
        let camera = read_camera(&folder.join("camera.json"))?;
        Ok(Run {
            finished: FinishedRun::read(&folder)?,
            camera,
            summary,
            frames: folder.join("frames.jsonl"),
        })
    }
}

/// Runs each video as a camera at rest films it, and as a moving camera films it, and compares the runs. Folders of
/// rendered clips are scored against their truth instead. The films and results go into subfolders of `work`.
///
/// # Errors
/// [`LabError`] for the first input that cannot be filmed, run or read.
pub fn evaluate_motion(
    inputs: &[PathBuf],
    work: &Path,
    options: &MotionOptions,
    config: &Config,
    cancel: &Cancel,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    // The films are whole: `decode` chooses the part that is filmed.
    let mut whole = config.clone();
    (whole.decode.start_s, whole.decode.end_s, whole.decode.max_frames) = (0.0, None, None);
    let runner = Runner { work, models: &options.models, config: &whole, cancel };
    let mut tables = Vec::new();
    let (folders, videos): (Vec<_>, Vec<_>) = inputs.iter().partition(|input| input.is_dir());
    if !videos.is_empty() {
        let mut table = empty_table();
        for video in videos {
            let clip =
                Clip::open(video, &config.decode, options.seconds, options.mirrored, options.distortion)?;
            films(&clip, options, &runner, &mut table)?;
            progress.frame_done();
        }
        tables.push(table);
    }
    for folder in folders {
        tables.extend(turned::against_truth(folder, &runner)?);
        progress.frame_done();
    }
    Ok(Report { title: "Moving cameras".to_owned(), tables, ..Report::default() })
}

fn empty_table() -> Table {
    let columns = [
        ("clip", 0),
        ("motion", 0),
        ("tracks", 0),
        ("at rest, in view", 0),
        ("observed, %", 1),
        ("place to 60 m, m", 2),
        ("place beyond, sds", 2),
        ("focal, px", 0),
        ("sd, px", 0),
        ("focal, sds", 2),
        ("turns: focal, px", 0),
        ("turns: sd, px", 0),
        ("distortion", 4),
        ("distortion, sd", 4),
        ("segments", 0),
        ("frames not followed", 0),
        ("CPU", 2),
    ];
    let note = "Films of the clip by a camera that turns or zooms about its centre, by homographies K R K⁻¹. All \
                focal lengths are those of the film at rest. \
                At rest, in view: tracks at rest of which the film shows an observed row. Observed: share of the observed rows at rest, in view of the film, that are also observed in the film. \
                Place: rms distance of the rows of both films on the ground; missing if the film has several segments. \
                Focal, sds: difference to the film at rest, in its sds. Turns: focal length from the motion alone. Distortion: that of the lens at half the width; missing if it was not determined. \
                CPU: processor time, divided by that of the film at rest without region-of-interest scheduling.";
    Table::new(
        "Films against the film at rest",
        note,
        columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
    )
}

/// Films a clip with each motion, runs the films, and adds a row for each.
fn films(
    clip: &Clip,
    options: &MotionOptions,
    runner: &Runner<'_>,
    table: &mut Table,
) -> Result<(), LabError> {
    let films = runner.folder("films")?;
    let path = |motion: Motion| films.join(format!("{}_{}.mp4", clip.name(), motion.name()));
    // A film at rest does not depend on the focal length.
    clip.film(Motion::Rest, 1.0, &path(Motion::Rest))?;
    let rest_ratio = clip.film_focal_ratio(Motion::Rest, 0.0);
    let given = |ratio: f64| options.focal_px.filter(|_| options.is_focal_given).map(|px| px * ratio);
    let rest = runner.run(&path(Motion::Rest), given(rest_ratio), true)?;
    let full_ms = runner.run(&path(Motion::Rest), given(rest_ratio), false)?.cpu_ms();
    let focal_px = options.focal_px.unwrap_or(rest.finished.camera.focal_px / rest_ratio);
    let at_rest = Rows::new(&rest.finished.rows);
    for motion in clip.motions().filter(|motion| *motion == Motion::Rest || options.motions.contains(motion))
    {
        let ratio = clip.film_focal_ratio(motion, 0.0);
        let moving;
        let run = if motion == Motion::Rest {
            &rest
        } else {
            clip.film(motion, focal_px, &path(motion))?;
            moving = runner.run(&path(motion), given(ratio), true)?;
            &moving
        };
        let change = |frame: u64, bbox_px: &[f64; 4]| {
            let [rest, moving] = [Motion::Rest, motion].map(|motion| clip.view(motion, frame, focal_px));
            bbox_mapped(bbox_px, |pixel| moving.film_from_clip(&rest.clip_from_film(pixel)))
        };
        let difference = at_rest.compare(&Rows::new(&run.finished.rows), clip.film_size(motion), change);
        let segments = run.camera.segments.len().max(1);
        let place = |value: f64| if segments == 1 { value } else { f64::NAN };
        // Focal lengths in pixels of the film at rest.
        let as_at_rest = rest_ratio / ratio;
        let focal = run.finished.camera.focal_px * as_at_rest;
        let sd = run.finished.camera.focal_sd_px.unwrap_or(f64::NAN) * as_at_rest;
        let rest_sd = rest.finished.camera.focal_sd_px.unwrap_or(f64::NAN);
        let [turns_px, turns_sd_px] = run.turn_focal_px().map(|px| px * as_at_rest);
        let numbers = [
            track_count(&run.finished.rows) as f64,
            difference.tracks_in_view as f64,
            100.0 * difference.observed,
            place(difference.near_m),
            place(difference.far_sds),
            focal,
            sd,
            (focal - rest.finished.camera.focal_px) / rest_sd,
            turns_px,
            turns_sd_px,
            run.camera.camera.lens.as_ref().map_or(f64::NAN, |lens| lens.bend),
            run.camera.camera.lens.as_ref().map_or(f64::NAN, |lens| lens.bend_sd),
            segments as f64,
            run.summary.counts.frames_not_followed as f64,
            run.cpu_ms() / full_ms,
        ];
        let names = [Cell::from(clip.name()), Cell::from(motion.name())];
        table.rows.push(names.into_iter().chain(numbers.map(Cell::from)).collect());
    }
    Ok(())
}
