//! `roadplane cameras`: reads and changes a camera database.

use std::io::{Write as _, stdout};

use roadplane_pipeline::{Config, EvidenceStore, PipelineError, StoredCamera, merge_cameras, stored_cameras};
use serde_json::json;

use crate::args::cameras::{CamerasArgs, CamerasCommand};
use roadplane_terminal::Outcome;

/// Lists, shows, merges or removes cameras.
pub fn cameras(args: &CamerasArgs) -> anyhow::Result<Outcome> {
    match &args.operation {
        CamerasCommand::List(args) => {
            let store = EvidenceStore::new(&args.folder);
            let cameras = store.cameras().map_err(PipelineError::from)?;
            for camera in &cameras {
                let epochs = stored_cameras(&store, camera, &Config::default())?;
                if let Some(last) = epochs.last() {
                    print(camera, epochs.len(), last, args.json)?;
                }
            }
            if cameras.is_empty() {
                tracing::info!("the camera database is empty: {}", args.folder.display());
            }
        }
        CamerasCommand::Show(args) => {
            let store = EvidenceStore::new(&args.folder);
            let epochs = stored_cameras(&store, &args.camera, &Config::default())?;
            if epochs.is_empty() {
                return Err(unknown(&args.camera, store.folder()).into());
            }
            for (index, epoch) in epochs.iter().enumerate() {
                print(&args.camera, index + 1, epoch, args.json)?;
                for clip in epoch.clips.iter().filter(|_| !args.json) {
                    writeln!(stdout(), "  {}  {}", clip.recorded, clip.name)?;
                }
            }
        }
        CamerasCommand::Merge(args) => {
            for folder in &args.from {
                let fail = |source| PipelineError::Unreadable { source, path: folder.clone() };
                folder.metadata().map_err(fail)?;
            }
            let merged = merge_cameras(&args.from, &args.out)?;
            tracing::info!("{merged} new clips: {}", args.out.display());
        }
        CamerasCommand::Forget(args) => {
            let store = EvidenceStore::new(&args.folder);
            if !store.forget(&args.camera).map_err(PipelineError::from)? {
                return Err(unknown(&args.camera, store.folder()).into());
            }
        }
    }
    Ok(Outcome::Done)
}

fn unknown(camera: &str, folder: &std::path::Path) -> PipelineError {
    PipelineError::usage(&format!(
        "no camera {camera:?} in the database {0}: `roadplane cameras list {0}` lists its cameras",
        folder.display()
    ))
}

/// Prints an epoch as a line or as a JSON object.
fn print(camera: &str, epoch: usize, stored: &StoredCamera, as_json: bool) -> anyhow::Result<()> {
    let params = &stored.estimate.params;
    let sd = |i: usize| stored.estimate.covariance[(i, i)].max(0.0).sqrt();
    let (focal_px, height_m) = (params.focal_px(), params.log_height.exp());
    let (from, to) = (stored.clips.first(), stored.clips.last());
    let [from, to] = [from, to].map(|clip| clip.map_or("", |clip| clip.recorded.as_str()));
    if as_json {
        let line = json!({
            "camera": camera, "epoch": epoch, "clips": stored.clips, "from": from, "to": to,
            "image_size_px": stored.estimate.image_size_px, "vehicles": stored.estimate.cars_used,
            "focal_px": focal_px, "focal_sd_px": focal_px * sd(0),
            "height_m": height_m, "height_sd_m": height_m * sd(3),
            "tilt_rad": params.tilt, "tilt_sd_rad": sd(1), "roll_rad": params.roll, "roll_sd_rad": sd(2),
            "status": stored.estimate.status,
        });
        writeln!(stdout(), "{line}")?;
    } else {
        writeln!(
            stdout(),
            "{camera}, epoch {epoch}: {} clips, {} vehicles, {from} – {to}: focal {focal_px:.0} ± {:.0} px, height \
             {height_m:.2} ± {:.2} m, tilt {:.2} ± {:.2}°, roll {:.2} ± {:.2}°",
            stored.clips.len(),
            stored.estimate.cars_used,
            focal_px * sd(0),
            height_m * sd(3),
            params.tilt.to_degrees(),
            sd(1).to_degrees(),
            params.roll.to_degrees(),
            sd(2).to_degrees(),
        )?;
    }
    Ok(())
}
