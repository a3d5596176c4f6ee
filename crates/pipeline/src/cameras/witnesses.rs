//! Adds factors from vertical lines of the scene and from turns of the camera to a clip's camera.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use roadplane_base::{CameraEstimate, Factor, FrameRecord, SceneLine};
use roadplane_calibrate::{
    FuseOptions, Turns, Verticals, WindowEstimate, beside_a_witness, condense, fuse, verticals,
};
use roadplane_write::SceneLinesSummary;

/// Scene lines of frames, each set with its time (s).
#[derive(Clone, Debug, Default)]
pub(crate) struct ToldLines(Vec<(f64, Vec<SceneLine>)>);

impl ToldLines {
    /// Takes the scene lines out of a frame.
    pub(crate) fn take(&mut self, frame: &mut FrameRecord) {
        if let Some(lines) = frame.scene_lines.take() {
            self.0.push((frame.time_s, lines));
        }
    }

    /// Returns the last lines of each camera position.
    pub(crate) fn by_position(self, position_at: impl Fn(f64) -> usize) -> BTreeMap<usize, Vec<SceneLine>> {
        self.0.into_iter().map(|(time_s, lines)| (position_at(time_s), lines)).collect()
    }
}

/// Data from which factors on the focal length may be built, by camera position.
#[derive(Clone, Debug, Default)]
pub(crate) struct Heard {
    /// Lines of the scene.
    pub lines: BTreeMap<usize, Vec<SceneLine>>,
    /// Focal length from turns and zooms.
    pub turns: BTreeMap<usize, Turns>,
}

/// The data of one camera position, and the factors from them.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneView {
    /// Index of the camera position, from 0.
    pub position: usize,
    /// Lines of the scene.
    pub lines: Vec<SceneLine>,
    /// Vertical from the lines; `None` where the lines do not show one.
    pub verticals: Option<Verticals>,
    /// Focal length from turns and zooms of the camera; `None` where they do not determine it.
    pub turns: Option<Turns>,
}

impl SceneView {
    /// Returns the entry of `summary.json`.
    #[must_use]
    pub fn summary(&self) -> SceneLinesSummary {
        let upright = self.verticals.iter().flat_map(|found| &found.upright).filter(|upright| **upright);
        SceneLinesSummary {
            segment: self.position,
            found: self.lines.len(),
            upright: upright.count(),
            gain: self.verticals.as_ref().map(|found| (10.0 * found.gain).round() / 10.0),
            turn_focal_px: self.turns.map(|found| (10.0 * found.focal_px).round() / 10.0),
            turn_focal_sd_px: self.turns.map(|found| (10.0 * found.focal_px * found.log_sd).round() / 10.0),
        }
    }
}

/// Number of rounds of joining a factor; cars are linearised at the result of each round.
const ROUNDS: usize = 6;

/// Builds the factors of each camera position and adds them to `options`.
///
/// Where there is a factor, the windows of the position are replaced by one window that is linearised for the join. A
/// position without one constant camera (drift, or a move without a verdict) gets no factor. Neither does a camera
/// whose focal length the user gave.
pub(crate) fn hear_witnesses(
    windows: &mut Vec<WindowEstimate>,
    heard: &Heard,
    options: &mut FuseOptions,
) -> Vec<SceneView> {
    let mut views = Vec::new();
    let positions: BTreeSet<usize> = heard.lines.keys().chain(heard.turns.keys()).copied().collect();
    for position in positions {
        let lines = heard.lines.get(&position).cloned().unwrap_or_default();
        let here: Vec<WindowEstimate> = windows.iter().filter(|w| w.segment == position).cloned().collect();
        let turns = heard.turns.get(&position).copied();
        let mut view = SceneView { position, lines, verticals: None, turns: None };
        if let (false, [cars], Some(together)) =
            (options.focal_given, &fuse(&here, options)[..], condense(&here, options))
        {
            let mut beside = together.clone();
            let mut cars = cars.clone();
            view.turns = turns;
            if let Some(found) = view.turns {
                add_clue(&mut options.factors, position, found.factor());
                (cars, beside) = beside_clues(&together, cars, options);
            }
            view.verticals = verticals(&view.lines, &cars);
            if let Some(found) = &view.verticals {
                add_clue(&mut options.factors, position, found.factor);
                (_, beside) = beside_clues(&together, cars, options);
            }
            if view.turns.is_some() || view.verticals.is_some() {
                let first = windows.iter().position(|w| w.segment == position).unwrap_or(windows.len());
                windows.retain(|w| w.segment != position);
                windows.insert(first, beside);
            }
        }
        if heard.lines.contains_key(&position) || view.turns.is_some() {
            views.push(view);
        }
    }
    views
}

/// Joins a window with the factors of its position.
///
/// Returns the resulting camera, and the window linearised at that camera.
fn beside_clues(
    window: &WindowEstimate,
    mut camera: CameraEstimate,
    options: &FuseOptions,
) -> (CameraEstimate, WindowEstimate) {
    for _ in 0..ROUNDS {
        if let Some(joined) = fuse(&[beside_a_witness(window, &camera.params)], options).pop() {
            camera = joined;
        }
    }
    let window = beside_a_witness(window, &camera.params);
    (camera, window)
}

/// Adds a factor to a camera position.
fn add_clue(factors: &mut BTreeMap<usize, Arc<[Factor]>>, position: usize, factor: Factor) {
    let here = factors.entry(position).or_insert_with(|| Arc::new([]));
    *here = here.iter().copied().chain([factor]).collect();
}

/// Adds the factors from lines and turns to other factors, by camera position.
pub(crate) fn and_witnesses(factors: &mut BTreeMap<usize, Arc<[Factor]>>, views: &[SceneView]) {
    for view in views {
        let of_lines = view.verticals.as_ref().map(|found| found.factor);
        let of_turns = view.turns.map(|found| found.factor());
        for factor in of_lines.into_iter().chain(of_turns) {
            add_clue(factors, view.position, factor);
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
