//! The scene's own lines as a witness beside the cars: when they are looked for, and what they do to a clip's camera.

use std::collections::BTreeMap;
use std::sync::Arc;

use image::RgbImage;
use roadplane_base::{CarRecord, Clue, FrameRecord, PictureVerdict, SceneCurve, SceneLine};
use roadplane_calibrate::{
    FuseOptions, Verticals, WindowEstimate, beside_a_witness, condense, fuse, verticals,
};
use roadplane_watch::{Seen, scene_curves, scene_lines};
use roadplane_write::SceneLinesSummary;

use crate::PipelineError;
use crate::stream::streaming::stretch_of;

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

/// Lines as frames told them, each with its time.
#[derive(Clone, Debug, Default)]
pub(crate) struct ToldLines(Vec<(f64, Vec<SceneLine>)>);

impl ToldLines {
    /// Takes what a frame tells.
    pub(crate) fn take(&mut self, frame: &mut FrameRecord) {
        if let Some(lines) = frame.scene_lines.take() {
            self.0.push((frame.time_s, lines));
        }
    }

    /// The last ones of each position of the camera.
    pub(crate) fn by_position(self, position_at: impl Fn(f64) -> usize) -> BTreeMap<usize, Vec<SceneLine>> {
        self.0.into_iter().map(|(time_s, lines)| (position_at(time_s), lines)).collect()
    }
}

/// Lines of a position of the camera, and what they came to.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneView {
    /// Position of the camera, from 0.
    pub position: usize,
    /// The lines.
    pub lines: Vec<SceneLine>,
    /// The vertical that they show; `None` where they do not.
    pub verticals: Option<Verticals>,
}

impl SceneView {
    /// For `summary.json`.
    #[must_use]
    pub fn summary(&self) -> SceneLinesSummary {
        let upright = self.verticals.iter().flat_map(|found| &found.upright).filter(|upright| **upright);
        SceneLinesSummary {
            segment: self.position,
            found: self.lines.len(),
            upright: upright.count(),
            gain: self.verticals.as_ref().map(|found| (10.0 * found.gain).round() / 10.0),
        }
    }
}

/// Rounds of following a witness: cars are linearised where the join leads.
const ROUNDS: usize = 6;

/// Where the lines of a position show the vertical, its windows become one that is joined beside it, and it becomes a clue. A
/// position in which the camera drifts or was moved unseen has no one picture, and no witness.
pub(crate) fn hear_witnesses(
    windows: &mut Vec<WindowEstimate>,
    lines: &BTreeMap<usize, Vec<SceneLine>>,
    options: &mut FuseOptions,
) -> Vec<SceneView> {
    let mut views = Vec::new();
    for (&position, lines) in lines {
        let here: Vec<WindowEstimate> = windows.iter().filter(|w| w.segment == position).cloned().collect();
        let verticals = (|| {
            let [cars] = &fuse(&here, options)[..] else { return None };
            // Who knows the focal length asks nobody.
            let found = (!options.focal_given).then(|| verticals(lines, cars))??;
            let together = condense(&here, options)?;
            let with = with_clue(options, position, found.clue);
            let mut at = cars.params;
            for _ in 0..ROUNDS {
                let [joined] = &fuse(&[beside_a_witness(&together, &at)], &with)[..] else {
                    return None;
                };
                at = joined.params;
            }
            Some((found, beside_a_witness(&together, &at)))
        })();
        let verticals = verticals.map(|(found, window)| {
            let first = windows.iter().position(|w| w.segment == position).unwrap_or(windows.len());
            windows.retain(|w| w.segment != position);
            windows.insert(first, window);
            add_clue(&mut options.clues, position, found.clue);
            found
        });
        views.push(SceneView { position, lines: lines.clone(), verticals });
    }
    views
}

/// The options with one more clue on a position.
fn with_clue(options: &FuseOptions, position: usize, clue: Clue) -> FuseOptions {
    let mut options = options.clone();
    add_clue(&mut options.clues, position, clue);
    options
}

fn add_clue(clues: &mut BTreeMap<usize, Arc<[Clue]>>, position: usize, clue: Clue) {
    let here = clues.entry(position).or_insert_with(|| Arc::new([]));
    *here = here.iter().copied().chain([clue]).collect();
}

/// Adds the verticals that were found to other clues, by position.
pub(crate) fn and_verticals(clues: &mut BTreeMap<usize, Arc<[Clue]>>, views: &[SceneView]) {
    for view in views {
        if let Some(found) = &view.verticals {
            add_clue(clues, view.position, found.clue);
        }
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

    #[test]
    fn the_last_lines_of_a_position_count() {
        let line = |x: f64| vec![SceneLine::from([x, 0.0, x, 50.0, 0.01])];
        let told = ToldLines(vec![(0.0, line(1.0)), (4.0, line(2.0)), (50.0, line(3.0))]);
        let by_position = told.by_position(|time_s| usize::from(time_s > 40.0));
        assert_eq!(by_position, [(0, line(2.0)), (1, line(3.0))].into());
    }
}
