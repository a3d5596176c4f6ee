//! When the scene's own lines are looked for, in the picture of the place.

use image::RgbImage;
use roadplane_base::{CarRecord, PictureVerdict, SceneCurve, SceneLine};
use roadplane_watch::{Seen, scene_curves, scene_lines};

use crate::PipelineError;
use crate::stream::cadence::stretch_of;

/// Ages of a position of the camera at which lines are looked for, s: at once, and when ever more of the place was seen bare.
const AGES_S: [f64; 3] = [0.0, 4.0, 30.0];

/// Lines that may be vertical, and long edges.
type SceneEdges = (Vec<SceneLine>, Vec<SceneCurve>);

/// Looks for lines when they are due. Only within the minute of the input in which a position began, so that a resumed run,
/// which goes on at a full minute, finds the same.
#[derive(Debug)]
pub(crate) struct LineFinder {
    began_s: Option<f64>,
    looked: usize,
    /// Nothing before the next move: an earlier run looked, or nobody wants lines.
    is_done: bool,
}

impl LineFinder {
    /// From the input's start, or, `is_done`, from the next move on.
    pub(crate) fn new(is_done: bool) -> Self {
        Self { began_s: None, looked: 0, is_done }
    }

    /// Finds lines and long edges of the place in its picture, if they are due.
    pub(crate) fn look(
        &mut self,
        seen: &Seen,
        place: &RgbImage,
        cars: &[CarRecord],
        time_s: f64,
    ) -> Result<Option<SceneEdges>, PipelineError> {
        if seen.is_new_position {
            *self = Self::new(false);
        }
        let is_steady = matches!(seen.record.verdict, PictureVerdict::Rest | PictureVerdict::Unknown);
        if self.is_done || !is_steady {
            return Ok(None);
        }
        let began_s = *self.began_s.get_or_insert(time_s);
        if stretch_of(began_s) != stretch_of(time_s) {
            self.is_done = true;
            return Ok(None);
        }
        let due = AGES_S.iter().filter(|age_s| time_s - began_s >= **age_s).count();
        if due <= self.looked {
            return Ok(None);
        }
        self.looked = due;
        self.is_done = due == AGES_S.len();
        let boxes: Vec<[f64; 4]> = cars.iter().map(|car| car.bbox_px).collect();
        Ok(Some((scene_lines(place, &boxes)?, scene_curves(place, &boxes)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use roadplane_base::WatchRecord;
    use roadplane_watch::SmallGrey;

    /// Times at which lines are looked for in pictures taken twice a second, with moves told at some of them.
    fn looked_s(mut finder: LineFinder, from_s: f64, to_s: f64, moves_s: &[f64]) -> Vec<f64> {
        let picture = RgbImage::new(64, 48);
        let times = (0..).map(|i| from_s + 0.5 * f64::from(i)).take_while(|time_s| *time_s < to_s);
        let is_due = |time_s: &f64| {
            let seen = Seen {
                record: WatchRecord { verdict: PictureVerdict::Rest, ..WatchRecord::default() },
                small: SmallGrey::of(&picture).unwrap(),
                shift: Vector2::zeros(),
                is_new_position: moves_s.iter().any(|move_s| (move_s - time_s).abs() < 0.1),
            };
            finder.look(&seen, &picture, &[], *time_s).unwrap().is_some()
        };
        times.filter(is_due).collect()
    }

    #[test]
    fn lines_are_looked_for_at_once_and_when_more_of_the_place_was_bare() {
        assert_eq!(looked_s(LineFinder::new(false), 0.0, 200.0, &[]), [0.0, 4.0, 30.0]);
        assert!(looked_s(LineFinder::new(true), 0.0, 200.0, &[]).is_empty());
    }

    #[test]
    fn a_resumed_run_looks_where_the_whole_one_does() {
        let moves_s = [50.0, 130.0];
        let whole = looked_s(LineFinder::new(false), 0.0, 200.0, &moves_s);
        assert_eq!(whole, [0.0, 4.0, 30.0, 50.0, 54.0, 130.0, 134.0, 160.0]);
        let resumed = looked_s(LineFinder::new(true), 60.0, 200.0, &moves_s);
        assert_eq!(resumed, [130.0, 134.0, 160.0]);
    }
}
