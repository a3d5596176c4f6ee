//! Command `roadplane stage track`: tracks the cars of a file of frames with keypoints. It writes the folder of a
//! finished run, without images.

use std::path::Path;
use std::time::Instant;

use roadplane_base::ShapeAtlas;
use roadplane_write::{Existing, OutputFolder, StageSeconds, Summary, write_summary};

use crate::estimation::{Given, solve_constrained_clip};
use crate::identity::{file_identity, versions};
use crate::options::RunReport;
use crate::output::finish::{note_solution, write_camera_and_place};
use crate::output::track_rows::{ShownRows, TrackRows};
use crate::{CameraConstraints, Cancel, Config, PipelineError};

/// Tracks the cars of a file of frames. Writes camera, poses, tracks and summary to the folder `out/<stem>/`, like a
/// run. The caller must have the lock of the folder `out`.
///
/// # Errors
/// Returns a [`PipelineError`] if the result cannot be completed. `out/<stem>/` is then unchanged.
pub fn track_file(
    frames: &Path,
    out: &Path,
    stem: &str,
    constraints: &CameraConstraints,
    existing: Existing,
    config: &Config,
    cancel: &Cancel,
) -> Result<RunReport, PipelineError> {
    let started = Instant::now();
    let atlas = ShapeAtlas::shipped()?;
    let mut summary = Summary {
        versions: versions(),
        input: file_identity(frames)?,
        config: serde_json::to_value(config).unwrap_or_default(),
        config_sha256: config.fingerprint(),
        ..Summary::default()
    };
    let folder = OutputFolder::begin(out, stem, existing)?;
    folder.clear(&[])?;
    let mut rows = TrackRows::new(folder.path(), None, ShownRows::default());
    let poses = folder.path().join("poses.jsonl");
    let given = Given::new(constraints);
    let solved = solve_constrained_clip(frames, &poses, &atlas, &given, &mut rows, config, cancel).and_then(
        |solution| {
            rows.finish()?;
            write_camera_and_place(folder.path(), &solution)?;
            Ok(solution)
        },
    );
    let solution = match solved {
        Ok(solution) => solution,
        Err(error) => {
            folder.discard()?;
            return Err(error);
        }
    };
    note_solution(&mut summary, &solution);
    summary.wall_s = started.elapsed().as_secs_f64();
    summary.seconds = vec![StageSeconds { stage: "solve".to_owned(), seconds: summary.wall_s }];
    write_summary(&folder.path().join("summary.json"), &summary)?;
    let tracks = Some(solution.shapes.len() as u64);
    let camera = solution.camera_in_words();
    Ok(RunReport {
        folder: folder.publish()?,
        tracks,
        camera,
        status: summary.status,
        frames_lost: 0,
        frames_not_followed: solution.not_followed.frames,
    })
}
