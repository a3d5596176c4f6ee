//! Witnesses beside the cars' poses, the scene's own lines and cars that are parallel: what they do to a clip's camera.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use roadplane_base::{CameraEstimate, Factor, FrameRecord, SceneLine};
use roadplane_calibrate::{
    CarHeading, FuseOptions, Parallel, Verticals, WindowEstimate, beside_a_witness, condense, fuse, parallel,
    verticals,
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

/// What may speak of the focal length beside the cars' poses, by the camera's position.
#[derive(Clone, Debug, Default)]
pub(crate) struct Heard {
    /// Lines of the scene.
    pub lines: BTreeMap<usize, Vec<SceneLine>>,
    /// How cars are turned.
    pub headings: BTreeMap<usize, Vec<CarHeading>>,
}

/// Witnesses of a position of the camera, and what they came to.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneView {
    /// Position of the camera, from 0.
    pub position: usize,
    /// The lines.
    pub lines: Vec<SceneLine>,
    /// The vertical that they show; `None` where they do not.
    pub verticals: Option<Verticals>,
    /// What cars say that are parallel; `None` where they tell the focal length less well than their poses do.
    pub parallel: Option<Parallel>,
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
            parallel_cars: self.parallel.map_or(0, |found| found.cars),
        }
    }
}

/// Rounds of following a witness: cars are linearised where the join leads.
const ROUNDS: usize = 6;

/// Where lines of a position show the vertical, or cars are parallel, its windows become one that is joined beside these factors. A
/// position in which the camera drifts or was moved unseen has no one picture, and no witness; who knows the focal length asks
/// none.
pub(crate) fn hear_witnesses(
    windows: &mut Vec<WindowEstimate>,
    heard: &Heard,
    options: &mut FuseOptions,
) -> Vec<SceneView> {
    let mut views = Vec::new();
    let positions: BTreeSet<usize> = heard.lines.keys().chain(heard.headings.keys()).copied().collect();
    for position in positions {
        let lines = heard.lines.get(&position).cloned().unwrap_or_default();
        let headings = heard.headings.get(&position).map_or(&[][..], Vec::as_slice);
        let here: Vec<WindowEstimate> = windows.iter().filter(|w| w.segment == position).cloned().collect();
        let mut view = SceneView { position, lines, verticals: None, parallel: None };
        if let (false, [cars], Some(together)) =
            (options.focal_given, &fuse(&here, options)[..], condense(&here, options))
        {
            let mut beside = together.clone();
            let mut cars = cars.clone();
            view.parallel = parallel(headings, cars.covariance[(0, 0)].sqrt());
            if let Some(found) = view.parallel {
                add_clue(&mut options.factors, position, found.factor);
                (cars, beside) = beside_clues(&together, cars, options);
            }
            view.verticals = verticals(&view.lines, &cars);
            if let Some(found) = &view.verticals {
                add_clue(&mut options.factors, position, found.factor);
                (_, beside) = beside_clues(&together, cars, options);
            }
            if view.parallel.is_some() || view.verticals.is_some() {
                let first = windows.iter().position(|w| w.segment == position).unwrap_or(windows.len());
                windows.retain(|w| w.segment != position);
                windows.insert(first, beside);
            }
        }
        if heard.lines.contains_key(&position) || view.parallel.is_some() {
            views.push(view);
        }
    }
    views
}

/// The camera that a window and the factors on its position come to, and the window as it is to be joined there.
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

fn add_clue(factors: &mut BTreeMap<usize, Arc<[Factor]>>, position: usize, factor: Factor) {
    let here = factors.entry(position).or_insert_with(|| Arc::new([]));
    *here = here.iter().copied().chain([factor]).collect();
}

/// Adds what witnesses said to other factors, by position.
pub(crate) fn and_witnesses(factors: &mut BTreeMap<usize, Arc<[Factor]>>, views: &[SceneView]) {
    for view in views {
        let of_cars = view.parallel.map(|found| found.factor);
        let of_lines = view.verticals.as_ref().map(|found| found.factor);
        for factor in of_cars.into_iter().chain(of_lines) {
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
