//! Writing of `tracks.csv`, and of all three track files together.

use std::path::Path;

use roadplane_base::TrackRow;

use crate::digits::{BEARING, DEGREES, METRES, PIXELS, RADIANS, SCORE, SECONDS, not_finite, rounded_row};
use crate::{JsonLines, OutFile, TrackParquet, WriteError};

/// Columns of `tracks.csv`.
const HEADER: [&str; 30] = [
    "frame",
    "time_s",
    "track",
    "x_m",
    "y_m",
    "heading_rad",
    "speed_mps",
    "x_sd_m",
    "y_sd_m",
    "heading_sd_rad",
    "length_m",
    "width_m",
    "height_m",
    "bbox_x0_px",
    "bbox_y0_px",
    "bbox_x1_px",
    "bbox_y1_px",
    "score",
    "observed",
    "activity",
    "class",
    "segment",
    "speed_sd_mps",
    "activity_p",
    "x_own_sd_m",
    "y_own_sd_m",
    "exists_p",
    "same_vehicle_p",
    "ground",
    "z_m",
];

/// Additional columns of `tracks.csv` if the user gave the camera's position on the map.
const ON_MAP_HEADER: [&str; 8] =
    ["latitude", "longitude", "utm_zone", "east_m", "north_m", "east_sd_m", "north_sd_m", "bearing_deg"];

/// The file `tracks.csv` in progress. The bounding box has four columns. A missing value is an empty field.
pub struct TrackCsv {
    writer: csv::Writer<OutFile>,
    on_map: bool,
    path: std::path::PathBuf,
}

impl TrackCsv {
    /// Starts a file and writes its header. If `on_map` is true, the file also has columns for positions on the map.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn create(path: &Path, on_map: bool) -> Result<Self, WriteError> {
        let writer = csv::Writer::from_writer(OutFile::create(path)?);
        let mut file = Self { writer, on_map, path: path.to_path_buf() };
        let more = if on_map { &ON_MAP_HEADER[..] } else { &[] };
        file.record(HEADER.iter().chain(more).map(|name| (*name).to_owned()))?;
        Ok(file)
    }

    /// Appends a row. Each column has a fixed number of decimals.
    ///
    /// # Errors
    /// [`WriteError::NotFinite`], [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn write(&mut self, row: &TrackRow) -> Result<(), WriteError> {
        if let Some(what) = not_finite(row) {
            return Err(WriteError::NotFinite { what: what.to_owned(), path: self.path.clone() });
        }
        let row = rounded_row(row);
        let fixed = |value: f64, decimals: i32| format!("{value:.*}", usize::try_from(decimals).unwrap_or(0));
        let metres = |value| fixed(value, METRES);
        let [x0, y0, x1, y1] = row.bbox_px.map(|v| fixed(v, PIXELS));
        let fields = [
            row.frame.to_string(),
            fixed(row.time_s, SECONDS),
            row.track.to_string(),
            metres(row.x_m),
            metres(row.y_m),
            fixed(row.heading_rad, RADIANS),
            metres(row.speed_mps),
            metres(row.x_sd_m),
            metres(row.y_sd_m),
            fixed(row.heading_sd_rad, RADIANS),
            metres(row.length_m),
            metres(row.width_m),
            metres(row.height_m),
            x0,
            y0,
            x1,
            y1,
            fixed(row.score, SCORE),
            row.observed.to_string(),
            row.activity.unwrap_or_default(),
            row.class.name().to_owned(),
            row.segment.to_string(),
            metres(row.speed_sd_mps),
            row.activity_p.map(|p| fixed(p, SCORE)).unwrap_or_default(),
            row.x_own_sd_m.map(metres).unwrap_or_default(),
            row.y_own_sd_m.map(metres).unwrap_or_default(),
            row.exists_p.map(|p| fixed(p, SCORE)).unwrap_or_default(),
            row.same_vehicle_p.map(|p| fixed(p, SCORE)).unwrap_or_default(),
            row.ground.to_string(),
            metres(row.z_m),
        ];
        let on_map = row.on_map.map(|at| {
            [
                fixed(at.latitude, DEGREES),
                fixed(at.longitude, DEGREES),
                at.utm_zone,
                metres(at.east_m),
                metres(at.north_m),
                metres(at.east_sd_m),
                metres(at.north_sd_m),
                fixed(at.bearing_deg, BEARING),
            ]
        });
        let on_map = self.on_map.then(|| on_map.unwrap_or_default());
        self.record(fields.into_iter().chain(on_map.into_iter().flatten()))
    }

    /// Completes the file and gives it its final name.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`]. After an error, no file with the final name appears.
    pub fn finish(self) -> Result<(), WriteError> {
        let Self { writer, path, .. } = self;
        let file = writer.into_inner().map_err(|e| WriteError::io("write", &path)(e.into_error()))?;
        file.finish()
    }

    fn record(&mut self, fields: impl Iterator<Item = String>) -> Result<(), WriteError> {
        self.writer.write_record(fields).map_err(WriteError::csv("write", &self.path))
    }
}

/// The files `tracks.parquet`, `tracks.jsonl` and `tracks.csv` of one result in progress. All three files have the same
/// numbers.
pub struct TrackFiles {
    parquet: TrackParquet,
    jsonl: JsonLines,
    csv: TrackCsv,
    path: std::path::PathBuf,
}

impl TrackFiles {
    /// Starts the three files in a folder. If `on_map` is true, `tracks.parquet` and `tracks.csv` also have columns for
    /// positions on the map.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn create(folder: &Path, on_map: bool) -> Result<Self, WriteError> {
        Ok(Self {
            parquet: TrackParquet::create(&folder.join("tracks.parquet"), on_map)?,
            jsonl: JsonLines::create(&folder.join("tracks.jsonl"))?,
            csv: TrackCsv::create(&folder.join("tracks.csv"), on_map)?,
            path: folder.to_path_buf(),
        })
    }

    /// Appends a row to each of the three files.
    ///
    /// # Errors
    /// [`WriteError::NotFinite`], [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn write(&mut self, row: &TrackRow) -> Result<(), WriteError> {
        if let Some(what) = not_finite(row) {
            let what = format!("{what} of track {} in frame {}", row.track, row.frame);
            return Err(WriteError::NotFinite { what, path: self.path.clone() });
        }
        self.parquet.write(row)?;
        self.jsonl.write(&rounded_row(row))?;
        self.csv.write(row)
    }

    /// Completes the three files and gives them their final names.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn finish(self) -> Result<(), WriteError> {
        self.parquet.finish()?;
        self.jsonl.finish()?;
        self.csv.finish()
    }
}
