//! The scene's own lines as a witness beside the cars: what they do to a clip's camera.

use std::collections::BTreeMap;
use std::sync::Arc;

use roadplane_base::{Clue, FrameRecord, SceneLine};
use roadplane_calibrate::{
    FuseOptions, Verticals, WindowEstimate, beside_a_witness, condense, fuse, verticals,
};
use roadplane_write::SceneLinesSummary;

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

    #[test]
    fn the_last_lines_of_a_position_count() {
        let line = |x: f64| vec![SceneLine::from([x, 0.0, x, 50.0, 0.01])];
        let told = ToldLines(vec![(0.0, line(1.0)), (4.0, line(2.0)), (50.0, line(3.0))]);
        let by_position = told.by_position(|time_s| usize::from(time_s > 40.0));
        assert_eq!(by_position, [(0, line(2.0)), (1, line(3.0))].into());
    }
}
