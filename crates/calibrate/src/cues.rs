//! Cues: sources of factors beside the cars and the user, for each camera position of a clip.
//!
//! The cues are vertical lines of the scene, and turns and zooms of the camera. A cue may depend on the camera that all
//! earlier cues give, for example to find the edges that can be vertical.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{FrameRecord, SceneLine};

use crate::factors::Factor;
use crate::{FuseOptions, Turns, Verticals, WindowEstimate, fuse, verticals};

/// Edges of the scene that may be vertical. Each set has the time at which it was found, s.
#[derive(Clone, Debug, Default)]
pub struct SceneLines(Vec<(f64, Vec<SceneLine>)>);

impl SceneLines {
    /// Takes the scene lines out of a frame.
    pub fn take(&mut self, frame: &mut FrameRecord) {
        if let Some(lines) = frame.scene_lines.take() {
            self.0.push((frame.time_s, lines));
        }
    }

    /// Returns the last lines of each camera position.
    #[must_use]
    pub fn by_position(self, position_at: impl Fn(f64) -> usize) -> BTreeMap<usize, Vec<SceneLine>> {
        self.0.into_iter().map(|(time_s, lines)| (position_at(time_s), lines)).collect()
    }
}

/// The data of cues, by camera position.
#[derive(Clone, Debug, Default)]
pub struct Cues {
    /// Edges that may be vertical.
    pub lines: BTreeMap<usize, Vec<SceneLine>>,
    /// Focal length from turns and zooms.
    pub turns: BTreeMap<usize, Turns>,
}

/// The data of one camera position, and the results from them.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneView {
    /// Index of the camera position, from 0.
    pub position: usize,
    /// Edges that may be vertical.
    pub lines: Vec<SceneLine>,
    /// Vertical from the lines; `None` where the lines do not show one.
    pub verticals: Option<Verticals>,
    /// Focal length from turns and zooms of the camera; `None` where they do not determine it.
    pub turns: Option<Turns>,
}

impl SceneView {
    /// Returns the factors of this position.
    fn factors(&self) -> impl Iterator<Item = Factor> + '_ {
        let of_turns = self.turns.iter().map(Turns::factor);
        of_turns.chain(self.verticals.iter().map(|found| Factor::Vertical(found.factor)))
    }

    /// Adds the factors of this position to other factors, by camera position.
    pub fn add_factors(&self, factors: &mut BTreeMap<usize, Vec<Factor>>) {
        factors.entry(self.position).or_default().extend(self.factors());
    }
}

impl Cues {
    /// Evaluates the cues of each position beside the windows and the factors of `options`.
    ///
    /// A position without a camera has no result. Neither has a camera whose focal length the user gave.
    #[must_use]
    pub fn evaluate(&self, windows: &[WindowEstimate], options: &FuseOptions) -> Vec<SceneView> {
        let positions: BTreeSet<usize> = self.lines.keys().chain(self.turns.keys()).copied().collect();
        let views = positions.into_iter().map(|position| {
            let lines = self.lines.get(&position).cloned().unwrap_or_default();
            let here: Vec<WindowEstimate> =
                windows.iter().filter(|window| window.segment == position).cloned().collect();
            let mut view = SceneView { position, lines, verticals: None, turns: None };
            if !options.focal_given {
                view.turns = self.turns.get(&position).copied();
                let mut options = options.clone();
                view.add_factors(&mut options.factors);
                match fuse(&here, &options).pop() {
                    Some(camera) => view.verticals = verticals(&view.lines, &camera),
                    None => view.turns = None,
                }
            }
            view
        });
        let has_data = |view: &SceneView| view.turns.is_some() || self.lines.contains_key(&view.position);
        views.filter(has_data).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_lines_of_a_position_count() {
        let line = |x: f64| vec![SceneLine::from([x, 0.0, x, 50.0, 0.01])];
        let told = SceneLines(vec![(0.0, line(1.0)), (4.0, line(2.0)), (50.0, line(3.0))]);
        let by_position = told.by_position(|time_s| usize::from(time_s > 40.0));
        assert_eq!(by_position, [(0, line(2.0)), (1, line(3.0))].into());
    }
}
