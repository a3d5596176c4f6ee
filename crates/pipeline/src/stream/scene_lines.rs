//! Decides when to search the background image for lines of the scene, and runs these searches.

use image::RgbImage;
use roadplane_base::{CarRecord, SceneCurve, SceneLine};
use roadplane_watch::{Observation, View, scene_curves, scene_lines};

use crate::PipelineError;
use crate::stream::cadence::interval_of;

/// Times of the searches for lines, s after the camera took its position. More of the background is visible in the
/// later searches.
const AGES_S: [f64; 3] = [0.0, 4.0, 30.0];

/// Straight lines that may be vertical in the world, and long edges that show the lens distortion.
type SceneEdges = (Vec<SceneLine>, Vec<SceneCurve>);

/// Searches the background image for lines of the scene, when a search is due.
///
/// After the camera takes a new position, searches run only until the end of the current minute of the input. A resumed
/// run continues at a full minute, so its searches are the same as in a run without a stop.
#[derive(Debug)]
pub(crate) struct LineFinder {
    began_s: Option<f64>,
    searches: usize,
    /// Whether no search is due before the next camera move, because all searches have been made or lines are not
    /// needed.
    is_done: bool,
}

impl LineFinder {
    /// Creates a finder. It searches from the first frame on, unless `is_done` is true. Then the lines of the current
    /// camera position are known, and it searches only after the next camera move.
    pub(crate) fn new(is_done: bool) -> Self {
        Self { began_s: None, searches: 0, is_done }
    }

    /// Finds lines and long edges in the background image, which shows the keyframe of `view`. Returns `None` if no
    /// search is due.
    pub(crate) fn find(
        &mut self,
        seen: &Observation,
        view: &View,
        background: &RgbImage,
        cars: &[CarRecord],
        time_s: f64,
    ) -> Result<Option<SceneEdges>, PipelineError> {
        if seen.is_new_position {
            *self = Self::new(false);
        }
        if self.is_done {
            return Ok(None);
        }
        let began_s = *self.began_s.get_or_insert(time_s);
        if interval_of(began_s) != interval_of(time_s) {
            self.is_done = true;
            return Ok(None);
        }
        let due = AGES_S.iter().filter(|age_s| time_s - began_s >= **age_s).count();
        if due <= self.searches {
            return Ok(None);
        }
        self.searches = due;
        self.is_done = due == AGES_S.len();
        let boxes: Vec<[f64; 4]> = cars.iter().map(|car| view.in_keyframe(&car.bbox_px)).collect();
        let mut lines = scene_lines(background, &boxes)?;
        // Lines of a frame are in its picture. Curves show the lens, wherever they are.
        if view.is_displaced() {
            for line in &mut lines {
                line.ends_px = line.ends_px.map(|end| view.picture_from_keyframe.apply(&end));
            }
        }
        Ok(Some((lines, scene_curves(background, &boxes)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::{PictureVerdict, WatchRecord};
    use roadplane_watch::SmallGrey;

    /// Returns the times of the searches, s. Pictures are taken twice a second, and the camera moves at the times
    /// `moves_s`.
    fn searched_s(mut finder: LineFinder, from_s: f64, to_s: f64, moves_s: &[f64]) -> Vec<f64> {
        let picture = RgbImage::new(64, 48);
        let times = (0..).map(|i| from_s + 0.5 * f64::from(i)).take_while(|time_s| *time_s < to_s);
        let is_due = |time_s: &f64| {
            let seen = Observation {
                record: WatchRecord { verdict: PictureVerdict::Rest, ..WatchRecord::default() },
                small: SmallGrey::of(&picture).unwrap(),
                view: Some(View::at_rest(&picture)),
                is_new_position: moves_s.iter().any(|move_s| (move_s - time_s).abs() < 0.1),
            };
            finder.find(&seen, &View::at_rest(&picture), &picture, &[], *time_s).unwrap().is_some()
        };
        times.filter(is_due).collect()
    }

    #[test]
    fn lines_are_searched_for_at_once_and_when_more_background_is_visible() {
        assert_eq!(searched_s(LineFinder::new(false), 0.0, 200.0, &[]), [0.0, 4.0, 30.0]);
        assert!(searched_s(LineFinder::new(true), 0.0, 200.0, &[]).is_empty());
    }

    #[test]
    fn a_resumed_run_searches_at_the_same_times_as_a_whole_run() {
        let moves_s = [50.0, 130.0];
        let whole = searched_s(LineFinder::new(false), 0.0, 200.0, &moves_s);
        assert_eq!(whole, [0.0, 4.0, 30.0, 50.0, 54.0, 130.0, 134.0, 160.0]);
        let resumed = searched_s(LineFinder::new(true), 60.0, 200.0, &moves_s);
        assert_eq!(resumed, [130.0, 134.0, 160.0]);
    }
}
