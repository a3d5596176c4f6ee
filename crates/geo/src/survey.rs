//! Files of surveyed points: `x_px, y_px, latitude, longitude[, height_m][, frame]`, one point per line.

use std::path::Path;

use roadplane_write::WriteError;

/// A surveyed point on or above the ground, and its pixel in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurveyPoint {
    /// Position in the picture, px.
    pub pixel: [f64; 2],
    /// Latitude, degrees, WGS 84.
    pub latitude: f64,
    /// Longitude, degrees, WGS 84.
    pub longitude: f64,
    /// Height of the point above the ground on which vehicles drive, m.
    pub height_m: f64,
    /// Index of the frame that has the pixel, from 0, if the camera moves. `None`: the camera's first picture.
    pub frame: Option<u64>,
}

impl SurveyPoint {
    /// Returns the ground point at a pixel, without a surveyed position.
    pub(crate) fn on_ground(pixel: [f64; 2]) -> Self {
        Self { pixel, latitude: 0.0, longitude: 0.0, height_m: 0.0, frame: None }
    }
}

/// Columns of a line without names. The last two are optional.
const COLUMNS: [&str; 6] = ["x_px", "y_px", "latitude", "longitude", "height_m", "frame"];

/// Reads a file of points.
///
/// The first line may name the columns; then `height_m` can be left out before `frame`.
///
/// # Errors
/// Returns [`WriteError::Io`] if the file cannot be read. Returns [`WriteError::Malformed`] with the number of the line
/// if a line is wrong.
pub fn read_points(path: &Path) -> Result<Vec<SurveyPoint>, WriteError> {
    let text = std::fs::read_to_string(path).map_err(|source| WriteError::Io {
        doing: "read",
        source,
        path: path.to_path_buf(),
    })?;
    let mut names: &[&str] = &COLUMNS;
    let mut points = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if i == 0 && fields.iter().all(|field| field.parse::<f64>().is_err()) {
            let is_without_height = fields.len() == 5 && fields[4] == COLUMNS[5];
            names = if is_without_height { &WITHOUT_HEIGHT } else { &COLUMNS };
            continue;
        }
        let point = point(&fields, names).ok_or_else(|| {
            let what =
                format!("line {} must have x_px, y_px, latitude, longitude[, height_m][, frame]", i + 1);
            WriteError::Malformed { what, path: path.to_path_buf() }
        })?;
        points.push(point);
    }
    Ok(points)
}

/// Columns of a line without heights.
const WITHOUT_HEIGHT: [&str; 5] = [COLUMNS[0], COLUMNS[1], COLUMNS[2], COLUMNS[3], COLUMNS[5]];

/// Reads the fields of a line, whose columns have these names. Returns `None` if a field is missing or wrong.
fn point(fields: &[&str], names: &[&str]) -> Option<SurveyPoint> {
    let field = |name: &str| {
        let column = names.iter().position(|other| *other == name)?;
        fields.get(column).copied().filter(|field| !field.is_empty())
    };
    let number = |name: &str| field(name)?.parse().ok().filter(|v: &f64| v.is_finite());
    if fields.len() > names.len() {
        return None;
    }
    Some(SurveyPoint {
        pixel: [number("x_px")?, number("y_px")?],
        latitude: number("latitude")?,
        longitude: number("longitude")?,
        height_m: if field("height_m").is_some() { number("height_m")? } else { 0.0 },
        frame: field("frame").map(|frame| frame.parse().ok()).map_or(Some(None), |frame| frame.map(Some))?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_optional_and_bad_lines_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("points.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_points(&path)
        };
        let points =
            read("x_px,y_px,latitude,longitude,height_m\n14, 259, 51.05, 13.9, 0.5\n1,2,51,13\n").unwrap();
        assert_eq!(points.len(), 2);
        assert_eq!((points[0].pixel, points[0].height_m, points[1].height_m), ([14.0, 259.0], 0.5, 0.0));
        assert_eq!(read("1,2,51,13\n").unwrap().len(), 1);
        let of = |text: &str| read(text).map(|points| (points[0].height_m, points[0].frame)).unwrap();
        assert_eq!(of("1,2,51,13,0.5,75\n"), (0.5, Some(75)));
        assert_eq!(of("x_px,y_px,latitude,longitude,frame\n1,2,51,13,75\n"), (0.0, Some(75)));
        assert_eq!(of("x_px,y_px,latitude,longitude,height_m,frame\n1,2,51,13,,\n"), (0.0, None));
        for text in [
            "1,2,51,13\n1,2,51\n",
            "\n1,x,51,13",
            "1,2,3,4\n1,2,nan,4\n",
            "\n1,2,51,13,0,7.5",
            "\n1,2,51,13,0,7,8",
        ] {
            assert!(read(text).unwrap_err().to_string().starts_with("line 2 must have"));
        }
    }
}
