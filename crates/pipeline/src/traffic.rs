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

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use roadplane_traffic::{Clock, Figures, Site, SiteClip, TRAFFIC_SCHEMA, TrafficCamera, TrafficFile, Units};

use roadplane_write::OutFile;

use crate::PipelineError;
use crate::cameras::memory::CameraId;
use gates_file::GatesFile;
use read_runs::{RunClip, read_input};

/// Options of the command.
#[derive(Clone, Debug)]
pub struct TrafficOptions {
    /// File with gates and zones.
    pub gates: Option<PathBuf>,
    /// Length of the periods, such as `15min`.
    pub every: String,
    /// Name of the time zone.
    pub time_zone: String,
    /// Local date and time of the first frame, for an input without a date in its name.
    pub start: Option<String>,
    /// Rule that assigns a camera to a clip; `None` if each clip is a camera of its own.
    pub camera_id: Option<String>,
    /// Units of speeds.
    pub units: Units,
}

/// What the command found.
#[derive(Debug)]
pub struct TrafficReport {
    /// The content of `traffic.json`.
    pub file: TrafficFile,
    /// The tables.
    pub figures: Figures,
    /// The cameras with their vehicles.
    pub sites: Vec<Site>,
}

/// Computes the tables of traffic of one or more inputs. An input is a result folder, a folder of such folders, or a
/// table of tracks.
///
/// # Errors
/// [`PipelineError::Usage`] for options that cannot be used, [`PipelineError::Write`] for files that cannot be read.
pub fn traffic(inputs: &[PathBuf], options: &TrafficOptions) -> Result<TrafficReport, PipelineError> {
    let usage = |e: roadplane_traffic::ClockError| PipelineError::usage(&e.to_string());
    let clock = Clock::new(&options.time_zone, &options.every).map_err(usage)?;
    let start_s = options.start.as_ref().map(|text| clock.parse_start(text)).transpose().map_err(usage)?;
    let camera_id = options.camera_id.as_deref().map(CameraId::new).transpose()?;
    let gates = options.gates.as_deref().map(GatesFile::read).transpose()?;
    let mut clips = Vec::new();
    for input in inputs {
        clips.extend(read_input(input, &clock, start_s)?);
    }
    let mut warnings = Vec::new();
    let mut figures = Figures::default();
    let (mut cameras, mut sites) = (Vec::new(), Vec::new());
    for (name, clips) in by_camera(clips, camera_id.as_ref(), &mut warnings)? {
        let mut site = Site { name, clips: Vec::new() };
        for RunClip { clip, world, .. } in clips {
            let (gates, zones) = match &gates {
                Some(file) => file.in_world(world.as_ref(), &clip.name)?,
                None => (Vec::new(), Vec::new()),
            };
            site.clips.push(SiteClip { clip, gates, zones });
        }
        let found = Figures::of(&site, &clock);
        cameras.push(TrafficCamera::of(&site, &clock));
        figures.extend(found);
        sites.push(site);
    }
    warnings.dedup();
    let file = TrafficFile {
        schema: TRAFFIC_SCHEMA.to_owned(),
        every: options.every.clone(),
        time_zone: options.time_zone.clone(),
        units: options.units,
        cameras,
        warnings,
        counts: figures.counts.clone(),
        speeds: figures.speeds.clone(),
        speed_histogram: figures.speed_histogram.clone(),
        headways: figures.headways.clone(),
        flows: figures.flows.clone(),
        zones: figures.zones.clone(),
    };
    Ok(TrafficReport { file, figures, sites })
}

/// Writes the tables, `traffic.json` and the page `traffic.html` into a folder.
///
/// # Errors
/// [`PipelineError::Write`].
pub fn write_traffic(report: &TrafficReport, folder: &Path, units: Units) -> Result<(), PipelineError> {
    tables::write_all(report, folder, units)?;
    let page = roadplane_view::traffic_html(&report.file, &report.sites);
    let mut file = OutFile::create(&folder.join("traffic.html"))?;
    file.write_all(page.as_bytes())
        .map_err(|source| PipelineError::Unreadable { source, path: folder.join("traffic.html") })?;
    file.finish().map_err(PipelineError::from)
}

/// Groups clips by camera. Clips without a date cannot be put in order, so each is a camera of its own.
fn by_camera(
    clips: Vec<RunClip>,
    camera_id: Option<&CameraId>,
    warnings: &mut Vec<String>,
) -> Result<BTreeMap<String, Vec<RunClip>>, PipelineError> {
    let mut cameras: BTreeMap<String, Vec<RunClip>> = BTreeMap::new();
    for clip in clips {
        let camera = match (&clip.camera, camera_id) {
            (Some(camera), _) => camera.clone(),
            (None, Some(id)) => id.of(Path::new(&clip.clip.name))?,
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
        cameras.entry(camera).or_default().push(clip);
    }
    for clips in cameras.values_mut() {
        clips.sort_by(|a, b| {
            let start = |c: &RunClip| c.clip.start_s.unwrap_or(0.0);
            start(a).total_cmp(&start(b)).then_with(|| a.clip.name.cmp(&b.clip.name))
        });
    }
    Ok(cameras)
}
