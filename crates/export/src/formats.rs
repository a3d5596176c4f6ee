//! The list of export formats. Each format has its own source file.

mod actev;
mod csv;
mod csv_table;
mod files;
mod geojson;
mod geoparquet;
mod highd;
mod kitti;
mod kml;
mod kpf;
mod mot;
mod ngsim;
mod ottrk;
mod rope3d;
mod ssam;
mod sumo;
mod ucmctrack;

use std::path::Path;

use roadplane_write::WriteError;

pub use geojson::write_paths;

use crate::Run;

/// A file format to which a run can be exported.
#[derive(Debug)]
pub struct Format {
    /// Name of the format on the command line. The folder of the format has the same name.
    pub name: &'static str,
    /// Short description of the contents and the files of the format.
    pub holds: &'static str,
    /// Returns the reason why a run cannot be written in this format, such as `needs activities, and …`.
    lacks: fn(&Run) -> Option<String>,
    pub(crate) write: fn(&Run, &Path) -> Result<(), WriteError>,
}

/// All export formats.
pub const FORMATS: [Format; 15] = [
    Format {
        name: "mot",
        holds: "MOT Challenge: boxes per frame, NAME.txt; seqinfo.ini",
        lacks: nothing,
        write: mot::write,
    },
    Format {
        name: "kitti",
        holds: "KITTI tracking: boxes in the picture and in 3D, label_02/NAME.txt; calib/NAME.txt",
        lacks: nothing,
        write: kitti::write,
    },
    Format {
        name: "kpf",
        holds: "KWIVER packets: boxes, types, activities; NAME.geom.yml, NAME.types.yml, NAME.activities.yml",
        lacks: nothing,
        write: kpf::write,
    },
    Format {
        name: "actev",
        holds: "NIST ActEV scorer: activities with boxes; NAME.json, file-index.json, activity-index.json",
        lacks: actev::lacks,
        write: actev::write,
    },
    Format {
        name: "csv",
        holds: "the rows of the run, with map coordinates if the run has them; NAME.csv",
        lacks: nothing,
        write: csv::write,
    },
    Format {
        name: "geojson",
        holds: "GeoJSON: one line per track, NAME.tracks.geojson; one point per row, NAME.rows.geojson",
        lacks: nothing,
        write: geojson::write,
    },
    Format {
        name: "geoparquet",
        holds: "GeoParquet: one line per track, NAME.tracks.parquet; one point per row, NAME.rows.parquet",
        lacks: nothing,
        write: geoparquet::write,
    },
    Format {
        name: "kml",
        holds: "KML for Google Earth: one path over time per track, NAME.kml; needs a position on the map",
        lacks: kml::lacks,
        write: kml::write,
    },
    Format {
        name: "sumo-fcd",
        holds: "SUMO floating car data: front bumpers per time step, NAME.fcd.xml; vehicle types, NAME.vtypes.xml",
        lacks: nothing,
        write: sumo::write,
    },
    Format {
        name: "ngsim",
        holds: "NGSIM: one table in feet and milliseconds, NAME.csv; no lanes",
        lacks: nothing,
        write: ngsim::write,
    },
    Format {
        name: "highd",
        holds: "highD: NAME_tracks.csv, NAME_tracksMeta.csv, NAME_recordingMeta.csv; x along the main direction, no lanes",
        lacks: nothing,
        write: highd::write,
    },
    Format {
        name: "ssam",
        holds: "SSAM, the safety model of the FHWA: vehicles per time step, NAME.trj; no lanes",
        lacks: nothing,
        write: ssam::write,
    },
    Format {
        name: "ottrk",
        holds: "OTVision and OTAnalytics: tracks in the picture, NAME.ottrk",
        lacks: nothing,
        write: ottrk::write,
    },
    Format {
        name: "ucmctrack",
        holds: "UCMCTrack: the camera, cam_para/NAME.txt",
        lacks: nothing,
        write: ucmctrack::write,
    },
    Format {
        name: "rope3d",
        holds: "Rope3D and DAIR-V2X: the camera, calib/NAME.txt; the ground plane, denorm/NAME.txt",
        lacks: nothing,
        write: rope3d::write,
    },
];

impl Format {
    /// Returns the format with a given name; `None` if there is no such format.
    #[must_use]
    pub fn of(name: &str) -> Option<&'static Self> {
        FORMATS.iter().find(|format| format.name == name)
    }

    /// Returns the reason why a run cannot be written in this format; `None` if it can be written. The reason is the
    /// rest of a sentence that begins with the name of the format.
    #[must_use]
    pub fn lacks(&self, run: &Run) -> Option<String> {
        (self.lacks)(run)
    }
}

/// The function [`Format::lacks`] of a format that every run has the data for.
fn nothing(_run: &Run) -> Option<String> {
    None
}
