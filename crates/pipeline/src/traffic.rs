//! Command `roadplane traffic`: tables of traffic from finished runs, or from tracks of other programs.
//!
//! ```text
//! read_runs.rs    result folders and tables → clips, one for each world frame     (samples.rs: samples → vehicles)
//! gates_file.rs   a file with gates and zones → lines and areas in each world     (world.rs: pixels, map → world)
//! tables.rs       figures → CSV, Parquet and JSON
//! ```

mod gates_file;
mod read_runs;
mod samples;
mod tables;
mod world;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use roadplane_traffic::{
    Clock, ClockError, Figures, Site, SiteClip, TRAFFIC_SCHEMA, TrafficCamera, TrafficFile, find_scene,
};
use roadplane_view::RoadPicture;
use roadplane_write::{OutFile, Summary};

use crate::PipelineError;
use crate::cameras::database::CameraId;
use crate::config::TrafficConfig;
use gates_file::GatesFile;
use read_runs::{RunClip, read_input, read_run};

/// Options of the command.
#[derive(Clone, Debug, Default)]
pub struct TrafficOptions {
    /// Gates, periods, time zone and units.
    pub tables: TrafficConfig,
    /// Local date and time of the first frame, for an input without a date in its name.
    pub start: Option<String>,
    /// Rule that assigns a camera to a clip; `None` if each clip is a camera of its own.
    pub camera_id: Option<String>,
}

/// The figures of the command, with their input.
#[derive(Debug)]
pub struct TrafficReport {
    /// The content of `traffic.json`, with all tables.
    pub file: TrafficFile,
    /// The cameras with their vehicles.
    pub sites: Vec<Site>,
}

/// Computes the tables of traffic of one or more inputs. An input is a result folder, a folder of such folders, or a
/// table of tracks.
///
/// # Errors
/// [`PipelineError::Usage`] for options that cannot be used, [`PipelineError::Write`] for files that cannot be read.
pub fn traffic(inputs: &[PathBuf], options: &TrafficOptions) -> Result<TrafficReport, PipelineError> {
    let clock = clock_of(&options.tables)?;
    let start_s = options.start.as_ref().map(|text| clock.parse_start(text)).transpose().map_err(usage)?;
    let camera_id = options.camera_id.as_deref().map(CameraId::new).transpose()?;
    let mut clips = Vec::new();
    for input in inputs {
        clips.extend(read_input(input, &clock, start_s)?);
    }
    let names: BTreeSet<&str> = clips.iter().map(|clip| clip.clip.name.as_str()).collect();
    if start_s.is_some() && names.len() > 1 {
        return Err(PipelineError::usage("--start is the date of one clip, but there are several"));
    }
    let mut warnings = Vec::new();
    let cameras = by_camera(clips, camera_id.as_ref(), &mut warnings);
    report(cameras, &options.tables, &clock, warnings)
}

/// Computes the tables of traffic of a run in progress. `folder` has its `camera.json` and `tracks.parquet`.
///
/// # Errors
/// As [`traffic`].
pub(crate) fn traffic_of_run(
    folder: &Path,
    name: &str,
    summary: &Summary,
    tables: &TrafficConfig,
) -> Result<TrafficReport, PipelineError> {
    let clock = clock_of(tables)?;
    let clips = read_run(folder, name, summary, &clock, None)?;
    report(by_camera(clips, None, &mut Vec::new()), tables, &clock, Vec::new())
}

/// Checks the settings of the tables, before any work is done.
///
/// # Errors
/// [`PipelineError::Usage`] for settings that cannot be used, [`PipelineError::Write`] for a file of gates that cannot be
/// read.
pub fn check_traffic(tables: &TrafficConfig) -> Result<(), PipelineError> {
    clock_of(tables)?;
    tables.gates.as_deref().map(GatesFile::read).transpose().map(|_read| ())
}

/// Returns the sections on traffic of a run's report, as HTML. `road` shows the road.
///
/// # Errors
/// [`PipelineError::View`] if the picture cannot be written.
pub(crate) fn traffic_sections(
    report: &TrafficReport,
    road: Option<&RoadPicture<'_>>,
) -> Result<String, PipelineError> {
    Ok(roadplane_view::traffic_sections(&report.file, &report.sites, road)?)
}

fn usage(error: ClockError) -> PipelineError {
    PipelineError::usage(&error.to_string())
}

fn clock_of(tables: &TrafficConfig) -> Result<Clock, PipelineError> {
    Clock::new(&tables.time_zone, &tables.every).map_err(usage)
}

fn report(
    cameras: BTreeMap<String, Vec<RunClip>>,
    tables: &TrafficConfig,
    clock: &Clock,
    mut warnings: Vec<String>,
) -> Result<TrafficReport, PipelineError> {
    let gates = tables.gates.as_deref().map(GatesFile::read).transpose()?;
    let (mut figures, mut described, mut sites) = (Figures::default(), Vec::new(), Vec::new());
    for (name, clips) in cameras {
        let site = match &gates {
            Some(gates) => drawn(name, clips, gates, &mut warnings)?,
            None => found(name, clips),
        };
        described.push(TrafficCamera::of(&site, clock));
        figures.extend(Figures::of(&site, clock));
        sites.push(site);
    }
    if figures.doubtful_conflicts > 0 {
        let n = figures.doubtful_conflicts;
        warnings.push(format!(
            "{n} pairs of vehicles are not listed as conflicts, because these vehicles overlap on the ground, with each other or \
             with others. The cause is an error of a position or a length; a crash would be one of these pairs"
        ));
    }
    warnings.dedup();
    let file = TrafficFile {
        schema: TRAFFIC_SCHEMA.to_owned(),
        every: tables.every.clone(),
        time_zone: tables.time_zone.clone(),
        units: tables.units,
        cameras: described,
        warnings,
        figures,
    };
    Ok(TrafficReport { file, sites })
}

/// Puts the gates and zones of a file into the worlds of clips, and finds the lanes.
fn drawn(
    name: String,
    clips: Vec<RunClip>,
    gates: &GatesFile,
    warnings: &mut Vec<String>,
) -> Result<Site, PipelineError> {
    let is_there = |clip: &RunClip| {
        let frame = gates.frame().zip(clip.world.as_ref());
        frame.is_none_or(|(frame, world)| world.has_frame(frame))
    };
    let somewhere = clips.iter().any(is_there);
    let mut site = Site { name, clips: Vec::new(), lanes: Vec::new() };
    for run in clips {
        let has_gates = is_there(&run);
        let RunClip { clip, world, .. } = run;
        let (drawn, zones) =
            if has_gates { gates.in_world(world.as_ref(), &clip.name)? } else { Default::default() };
        if !has_gates {
            let name = &clip.name;
            warnings.push(format!(
                "{name}: gates in pixels hold only for the position of the camera in frame {}",
                gates.frame().unwrap_or_default()
            ));
        }
        // Figures of a gate need all clips of a camera to have it. A clip without it counts as time without a camera.
        if has_gates || !somewhere {
            site.clips.push(SiteClip { clip, gates: drawn, zones });
        }
    }
    site.lanes = find_scene(&site.clips.iter().map(|one| &one.clip).collect::<Vec<_>>(), None).lanes;
    Ok(site)
}

/// Finds the roads that lead out of the picture, the lanes, and the stop lines. The roads are the gates. The lanes before stop
/// lines are zones.
fn found(name: String, clips: Vec<RunClip>) -> Site {
    let north_rad = clips.iter().find_map(|clip| clip.world.as_ref()?.bearing_rad());
    let scene = find_scene(&clips.iter().map(|clip| &clip.clip).collect::<Vec<_>>(), north_rad);
    let zones = scene.queue_zones();
    let gates: Vec<_> = scene.arms.into_iter().map(|arm| arm.gate).collect();
    let clips = clips.into_iter().map(|RunClip { clip, .. }| SiteClip {
        clip,
        gates: gates.clone(),
        zones: zones.clone(),
    });
    Site { name, clips: clips.collect(), lanes: scene.lanes }
}

/// Writes each diagram of the page as an SVG file into the folder `pictures` of a folder.
///
/// # Errors
/// [`PipelineError::Write`].
pub fn write_traffic_pictures(report: &TrafficReport, folder: &Path) -> Result<(), PipelineError> {
    let pictures = folder.join("pictures");
    std::fs::create_dir_all(&pictures)
        .map_err(|source| PipelineError::Unreadable { source, path: pictures.clone() })?;
    for (name, svg) in roadplane_view::traffic_pictures(&report.file, &report.sites) {
        let mut file = OutFile::create(&pictures.join(name))?;
        file.write_bytes(svg.as_bytes())?;
        file.finish()?;
    }
    Ok(())
}

/// Writes the tables, `traffic.json` and the page `traffic.html` into a folder. It uses up the vehicles of the report, so
/// that the memory of the tables does not add to theirs.
///
/// # Errors
/// [`PipelineError::Write`].
pub fn write_traffic(report: &mut TrafficReport, folder: &Path) -> Result<(), PipelineError> {
    let page = roadplane_view::traffic_html(&report.file, &report.sites);
    report.sites.clear();
    let mut file = OutFile::create(&folder.join("traffic.html"))?;
    file.write_bytes(page.as_bytes())?;
    file.finish()?;
    tables::write_all(report, folder).map_err(PipelineError::from)
}

/// Groups clips by camera. Clips without a date cannot be put in order, so each is a camera of its own.
fn by_camera(
    clips: Vec<RunClip>,
    camera_id: Option<&CameraId>,
    warnings: &mut Vec<String>,
) -> BTreeMap<String, Vec<RunClip>> {
    let mut cameras: BTreeMap<String, Vec<RunClip>> = BTreeMap::new();
    for clip in clips {
        let camera = match (&clip.camera, camera_id) {
            (Some(camera), _) => camera.clone(),
            // The suffix keeps the whole name, because a name may contain a dot.
            (None, Some(id)) => id.of(Path::new(&format!("{}.mp4", clip.clip.name))).unwrap_or_else(|| {
                let name = &clip.clip.name;
                warnings.push(format!(
                    "{name}: --camera-id finds no camera in the name; it is a camera of its own"
                ));
                name.clone()
            }),
            (None, None) => clip.clip.name.clone(),
        };
        if clip.clip.start_s.is_none() {
            let name = &clip.clip.name;
            warnings.push(format!(
                "{name}: its date is unknown, so its times are seconds; --start gives the date"
            ));
        }
        let camera = match clip.clip.start_s {
            None if camera_id.is_some() => format!("{camera}/{}", clip.clip.name),
            _ => camera,
        };
        // Each position of the camera has a world of its own.
        let camera = if clip.world_number > 1 { format!("{camera}/{}", clip.world_number) } else { camera };
        // Clips of one name in different folders are different cameras, unless a name of the camera is given.
        let is_alone = clip.clip.start_s.is_none() || (camera_id.is_none() && clip.camera.is_none());
        let is_taken = is_alone && cameras.contains_key(&camera);
        let camera = if is_taken { format!("{camera} ({})", cameras.len() + 1) } else { camera };
        cameras.entry(camera).or_default().push(clip);
    }
    for clips in cameras.values_mut() {
        clips.sort_by(|a, b| {
            let start = |c: &RunClip| c.clip.start_s.unwrap_or(0.0);
            start(a).total_cmp(&start(b)).then_with(|| a.clip.name.cmp(&b.clip.name))
        });
    }
    cameras
}
