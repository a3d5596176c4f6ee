//! Files of surveyed points: `x_px, y_px, latitude, longitude[, height_m]`, one point per line.

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
}

impl SurveyPoint {
    /// Returns the ground point at a pixel, without a surveyed position.
    pub(crate) fn on_ground(pixel: [f64; 2]) -> Self {
        Self { pixel, latitude: 0.0, longitude: 0.0, height_m: 0.0 }
    }
}

/// Reads a file of points. A first line of column names is skipped.
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
    let mut points = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let fields: Vec<Option<f64>> =
            line.split(',').map(|field| field.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        if i == 0 && fields.iter().all(Option::is_none) {
            continue;
        }
        let numbers: Option<Vec<f64>> = fields.into_iter().collect();
        let point = match numbers.as_deref() {
            Some([x, y, latitude, longitude]) => (*x, *y, *latitude, *longitude, 0.0),
            Some([x, y, latitude, longitude, height]) => (*x, *y, *latitude, *longitude, *height),
            _ => {
                let what = format!("line {} must have x_px, y_px, latitude, longitude[, height_m]", i + 1);
                return Err(WriteError::Malformed { what, path: path.to_path_buf() });
            }
        };
        let (x, y, latitude, longitude, height_m) = point;
        points.push(SurveyPoint { pixel: [x, y], latitude, longitude, height_m });
    }
    Ok(points)
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
        for text in ["1,2,51,13\n1,2,51\n", "\n1,x,51,13", "1,2,3,4\n1,2,nan,4\n"] {
            assert!(read(text).unwrap_err().to_string().starts_with("line 2 must have"));
        }
    }
}
