//! Cues: sources of factors beside the cars and the user, for each camera position of a clip.
//!
//! The cues are vertical lines of the scene, and turns and zooms of the camera. A cue may depend on the camera that all
//! earlier cues give, for example to find the edges that can be vertical.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::SceneLine;

use crate::factors::{Factor, Survey};
use crate::{FuseOptions, Turns, Verticals, WindowEstimate, fuse, verticals};

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
    /// Adds the factors of this position to other factors, by camera position.
    pub fn add_factors(&self, factors: &mut BTreeMap<usize, Vec<Factor>>) {
        let of_turn = |turns: Turns| Factor::Survey(Survey::of_number(0, turns.focal_px.ln(), turns.log_sd));
        let of_lines = self.verticals.iter().map(|found| Factor::Vertical(found.factor));
        let own = self.turns.map(of_turn).into_iter().chain(of_lines);
        factors.entry(self.position).or_default().extend(own);
    }
}

/// Evaluates the cues of each camera position beside the windows and the factors of `options`. The cues are edges of the
/// scene that may be vertical (`lines`), and the focal length from turns and zooms (`turns`).
///
/// A position without a camera has no result. Neither has a camera whose focal length the user gave.
#[must_use]
pub fn cues(
    mut lines: BTreeMap<usize, Vec<SceneLine>>,
    turns: &BTreeMap<usize, Turns>,
    windows: &[WindowEstimate],
    options: &FuseOptions,
) -> Vec<SceneView> {
    let positions: BTreeSet<usize> = lines.keys().chain(turns.keys()).copied().collect();
    let views = positions.into_iter().filter_map(|position| {
        let has_lines = lines.contains_key(&position);
        let lines = lines.remove(&position).unwrap_or_default();
        let mut view = SceneView { position, lines, verticals: None, turns: None };
        if !options.focal_given {
            view.turns = turns.get(&position).copied();
            let mut options = options.clone();
            view.add_factors(&mut options.factors);
            let here = windows.iter().filter(|window| window.position == position).cloned();
            match fuse(&here.collect::<Vec<_>>(), &options).pop() {
                Some(camera) => view.verticals = verticals(&view.lines, &camera),
                None => view.turns = None,
            }
        }
        (has_lines || view.turns.is_some()).then_some(view)
    });
    views.collect()
}
