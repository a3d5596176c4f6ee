//! The camera at every time of a clip.

use roadplane_base::{CameraEstimate, CameraEvidence};
use roadplane_geo::{Place, Site};
use roadplane_write::ConstraintSummary;

use crate::cameras::witnesses::SceneView;

/// The camera at every time of a clip.
#[derive(Clone, Debug, Default)]
pub struct CameraTrack {
    pub(super) estimates: Vec<CameraEstimate>,
    /// When each position of the camera after the first began, s.
    pub(super) moves_s: Vec<f64>,
    pub(super) said: Option<CameraEvidence>,
    pub(super) size_of_cars: f64,
    pub(super) known: Vec<ConstraintSummary>,
    pub(super) scene: Vec<SceneView>,
}

impl CameraTrack {
    /// Of estimates that were read back.
    #[must_use]
    pub fn from_estimates(estimates: Vec<CameraEstimate>) -> Self {
        Self { estimates, ..Self::default() }
    }

    /// What the clip alone says of its camera, for other clips to start from; where asked for, and where it says something.
    #[must_use]
    pub fn said(&self) -> Option<&CameraEvidence> {
        self.said.as_ref()
    }

    /// Log of how large the place's cars are against the atlas; 0 where nothing but cars tells scale.
    #[must_use]
    pub fn size_of_cars(&self) -> f64 {
        self.size_of_cars
    }

    /// What was told of the camera, against everything else.
    #[must_use]
    pub fn known(&self) -> &[ConstraintSummary] {
        &self.known
    }

    /// Lines of the scene and what they came to, by the camera's position.
    #[must_use]
    pub fn scene(&self) -> &[SceneView] {
        &self.scene
    }

    /// How often it was moved.
    #[must_use]
    pub fn moves(&self) -> usize {
        self.moves_s.len()
    }

    /// One estimate per stretch of time, in order; never empty.
    #[must_use]
    pub fn estimates(&self) -> &[CameraEstimate] {
        &self.estimates
    }

    /// Counts the positions that the camera was moved to up to a time.
    #[must_use]
    pub fn position_at(&self, time_s: f64) -> usize {
        self.moves_s.iter().filter(|from_s| **from_s <= time_s).count()
    }

    /// The estimate that holds at a time: whose stretch contains it, else the nearest.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<&CameraEstimate> {
        self.estimates.get(self.segment_at(time_s))
    }

    /// Puts the camera on the map; points refine it.
    ///
    /// # Errors
    /// What is wrong with the site; that the camera was moved.
    pub fn put_on_map(&mut self, site: &Site) -> Result<Place, String> {
        let [only] = self.estimates.as_mut_slice() else {
            return Err(format!(
                "the camera had {} positions, which have no one place",
                self.estimates.len()
            ));
        };
        let place = site.place(only)?;
        if matches!(site, Site::Points(_)) {
            *only = place.refined(only);
        }
        Ok(place)
    }

    /// Place of that estimate among all, from 0.
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
