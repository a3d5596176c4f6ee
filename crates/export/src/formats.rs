//! The list of export formats. Each format has its own source file.

mod actev;
mod csv;
mod csv_table;
mod files;
mod geojson;
mod highd;
mod kitti;
mod kpf;
mod mot;
mod ngsim;
mod sumo;

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
    pub(crate) write: fn(&Run, &Path) -> Result<(), WriteError>,
}

/// All export formats.
pub const FORMATS: [Format; 9] = [
    Format { name: "mot", holds: "MOT Challenge: boxes per frame, NAME.txt; seqinfo.ini", write: mot::write },
    Format {
        name: "kitti",
        holds: "KITTI tracking: boxes in the picture and in 3D, label_02/NAME.txt; calib/NAME.txt",
        write: kitti::write,
    },
    Format {
        name: "kpf",
        holds: "KWIVER packets: boxes, types, activities; NAME.geom.yml, NAME.types.yml, NAME.activities.yml",
        write: kpf::write,
    },
    Format {
        name: "actev",
        holds: "NIST ActEV scorer: activities with boxes; NAME.json, file-index.json, activity-index.json",
        write: actev::write,
    },
    Format {
        name: "csv",
        holds: "the rows of the run, with map coordinates if the run has them; NAME.csv",
        write: csv::write,
    },
    Format {
        name: "geojson",
        holds: "GeoJSON: one line per track, NAME.tracks.geojson; one point per row, NAME.rows.geojson",
        write: geojson::write,
    },
    Format {
        name: "sumo-fcd",
        holds: "SUMO floating car data: front bumpers per time step, NAME.fcd.xml; vehicle types, NAME.vtypes.xml",
        write: sumo::write,
    },
    Format {
        name: "ngsim",
        holds: "NGSIM: one table in feet and milliseconds, NAME.csv; no lanes",
        write: ngsim::write,
    },
    Format {
        name: "highd",
        holds: "highD: NAME_tracks.csv, NAME_tracksMeta.csv, NAME_recordingMeta.csv; x along the main direction, no lanes",
        write: highd::write,
    },
];

impl Format {
    /// Returns the format with a given name; `None` if there is no such format.
    #[must_use]
    pub fn of(name: &str) -> Option<&'static Self> {
        FORMATS.iter().find(|format| format.name == name)
    }
}
