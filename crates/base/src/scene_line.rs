//! Straight and nearly straight edges of the scene in the image.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A straight edge of the scene in the image. Files store it as `[x0, y0, x1, y1, sd]`. The numbers are both ends in
/// px, and the sd of the direction in rad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(into = "[f64; 5]", from = "[f64; 5]")]
pub struct SceneLine {
    /// Both ends of the edge in the picture, px.
    pub ends_px: [Vector2<f64>; 2],
    /// Sd of the measured direction, rad. It covers the error of the measurement, not the edge's deviation from the
    /// vertical in the world.
    pub sd_rad: f64,
}

impl From<[f64; 5]> for SceneLine {
    fn from([x0, y0, x1, y1, sd_rad]: [f64; 5]) -> Self {
        Self { ends_px: [Vector2::new(x0, y0), Vector2::new(x1, y1)], sd_rad }
    }
}

impl From<SceneLine> for [f64; 5] {
    fn from(line: SceneLine) -> Self {
        let [a, b] = line.ends_px;
        [a.x, a.y, b.x, b.y, line.sd_rad]
    }
}

impl SceneLine {
    /// Returns the edge with rounded numbers, as files store it.
    ///
    /// Pixels are rounded to 0.01, which is far below an edge's accuracy.
    #[must_use]
    pub fn rounded(self) -> Self {
        let rounded = |v: f64, digits: f64| (v * digits).round() / digits;
        Self {
            ends_px: self.ends_px.map(|end| end.map(|v| rounded(v, 100.0))),
            sd_rad: rounded(self.sd_rad, 1e5).max(1e-5),
        }
    }

    /// Returns the middle of the edge, px.
    #[must_use]
    pub fn middle_px(&self) -> Vector2<f64> {
        (self.ends_px[0] + self.ends_px[1]) / 2.0
    }

    /// Returns the vector from the first end to the second, px.
    #[must_use]
    pub fn along_px(&self) -> Vector2<f64> {
        self.ends_px[1] - self.ends_px[0]
    }

    /// Whether all numbers are finite, the two ends differ and the sd is positive.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let numbers: [f64; 5] = (*self).into();
        numbers.iter().all(|v| v.is_finite()) && self.along_px().norm() > 1e-3 && self.sd_rad > 0.0
    }
}

/// A long edge of the scene that would be straight, or gently curved, without lens distortion.
///
/// Files store it as `[x0, y0, x1, y1, x2, y2, sd]`, px. The points are one end, the middle and the other end. `sd` is
/// the sd of the distance between the middle and the line through the ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(into = "[f64; 7]", from = "[f64; 7]")]
pub struct SceneCurve {
    /// One end, the middle and the other end of the edge in the picture, px.
    pub points_px: [Vector2<f64>; 3],
    /// Sd of the distance between the middle and the line through the ends, px.
    pub sd_px: f64,
}

impl From<[f64; 7]> for SceneCurve {
    fn from([x0, y0, x1, y1, x2, y2, sd_px]: [f64; 7]) -> Self {
        Self { points_px: [Vector2::new(x0, y0), Vector2::new(x1, y1), Vector2::new(x2, y2)], sd_px }
    }
}

impl From<SceneCurve> for [f64; 7] {
    fn from(curve: SceneCurve) -> Self {
        let [a, b, c] = curve.points_px;
        [a.x, a.y, b.x, b.y, c.x, c.y, curve.sd_px]
    }
}

impl SceneCurve {
    /// Returns the edge with all numbers rounded to 0.01 px, as files store it.
    #[must_use]
    pub fn rounded(self) -> Self {
        let rounded = |v: f64| (v * 100.0).round() / 100.0;
        Self {
            points_px: self.points_px.map(|point| point.map(rounded)),
            sd_px: rounded(self.sd_px).max(0.01),
        }
    }

    /// Whether all numbers are finite, the two ends differ and the sd is positive.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let numbers: [f64; 7] = (*self).into();
        let chord = self.points_px[2] - self.points_px[0];
        numbers.iter().all(|v| v.is_finite()) && chord.norm() > 1e-3 && self.sd_px > 0.0
    }
}
