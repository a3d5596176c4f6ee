//! The camera at every time of a clip.

use std::collections::BTreeMap;

use roadplane_base::{CameraEstimate, CameraEvidence, PictureMotion};
use roadplane_calibrate::SceneView;
use roadplane_geo::{NotPlaced, Place, Site};
use roadplane_write::ConstraintSummary;

/// The estimated camera at every time of a clip.
#[derive(Clone, Debug, Default)]
pub struct CameraTrack {
    /// Estimates, one per interval, in the order of time; empty without frames.
    pub estimates: Vec<CameraEstimate>,
    /// Visits of the camera to its positions, in the order of time.
    pub(crate) visits: Vec<Visit>,
    /// Evidence of this clip alone, for the camera database; `None` if not requested or without information.
    pub evidence: Option<CameraEvidence>,
    /// Log of the size of the site's cars relative to the atlas; 0 where only cars determine the scale.
    pub size_of_cars: f64,
    /// Each user constraint, compared with all other evidence.
    pub constraints: Vec<ConstraintSummary>,
    /// Number of user constraints that hold at no position with an estimate, so that nothing is compared with them.
    pub(crate) not_compared: usize,
    /// Vertical lines and turns, by camera position.
    pub scene: Vec<SceneView>,
    /// Mapping from the world picture of the last position to the picture of the empty scene: the identity without a
    /// registration. `None` if that picture shows another position, and without frames.
    pub(crate) scene_from_world: Option<PictureMotion>,
}

/// An interval in which the camera is at one position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Visit {
    /// Index of the position, from 0.
    pub position: usize,
    /// First and last time, s.
    pub span_s: [f64; 2],
}

/// Returns the estimates of the positions in the order of time, one for each visit.
pub(super) fn by_visits(
    estimates: &BTreeMap<usize, CameraEstimate>,
    visits: &[Visit],
) -> Vec<CameraEstimate> {
    let of_visit = |visit: &Visit| {
        Some(CameraEstimate { span_s: visit.span_s, ..estimates.get(&visit.position)?.clone() })
    };
    // Every frame belongs to a visit.
    visits.iter().filter_map(of_visit).collect()
}

impl CameraTrack {
    /// Returns the index of the last camera position, from 0.
    #[must_use]
    pub fn last_position(&self) -> usize {
        self.visits.last().map_or(0, |visit| visit.position)
    }

    /// Returns the index of the camera position at a time, from 0. All visits to a position have the same index.
    #[must_use]
    pub fn position_at(&self, time_s: f64) -> usize {
        let begun = self.visits.iter().take_while(|visit| visit.span_s[0] <= time_s).last();
        begun.or(self.visits.first()).map_or(0, |visit| visit.position)
    }

    /// Returns the estimate whose interval contains a time, or else the nearest one.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<&CameraEstimate> {
        self.estimates.get(self.segment_at(time_s))
    }

    /// Places the camera on the map. Map points also refine it.
    ///
    /// # Errors
    /// An error in the site's description, points that contradict the camera, or a camera that was moved. The camera
    /// is then unchanged.
    pub fn put_on_map(&mut self, site: &Site) -> Result<Place, NotPlaced> {
        let [only] = self.estimates.as_mut_slice() else {
            let positions = self.estimates.len();
            return Err(NotPlaced::Unusable(format!("it was moved and had {positions} positions")));
        };
        let place = site.place(only)?;
        if matches!(site, Site::Points(_)) {
            *only = place.refined(only);
        }
        Ok(place)
    }

    /// Returns the index of the estimate whose interval contains a time, or else of the nearest one, from 0.
    #[must_use]
    pub fn segment_at(&self, time_s: f64) -> usize {
        let distance = |i: &usize| {
            let [from, to] = self.estimates[*i].span_s;
            (from - time_s).max(time_s - to).max(0.0)
        };
        let nearest = (0..self.estimates.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_visit_has_the_estimate_of_its_position() {
        let options = roadplane_calibrate::FuseOptions::for_image(roadplane_base::ImageSize {
            width: 1280,
            height: 720,
        });
        let visit = |position: usize, span_s: [f64; 2]| Visit { position, span_s };
        let visits = [visit(0, [0.0, 4.0]), visit(1, [4.0, 8.0]), visit(0, [8.0, 12.0])];
        let spans = |span_s: [f64; 2], position: usize| -> Vec<[f64; 2]> {
            by_visits(&[(position, options.unobservable(span_s))].into(), &visits)
                .iter()
                .map(|estimate| estimate.span_s)
                .collect()
        };
        assert_eq!(spans([1.0, 11.0], 0), [[0.0, 4.0], [8.0, 12.0]], "times without cars belong to it");
        assert_eq!(spans([9.0, 11.0], 0), [[0.0, 4.0], [8.0, 12.0]], "no cars in the first visit");
        assert_eq!(spans([5.0, 7.0], 1), [[4.0, 8.0]], "position 0 has no estimate");
    }
}
