//! Groups the evidence of many clips of one camera into epochs. In an epoch the camera was not moved.
//!
//! The camera database stores the set of the clips' evidence; everything else follows from this set alone. Clips are
//! taken in the order of their [`ClipIdentity`](roadplane_base::ClipIdentity); each joins an epoch or begins one. A
//! clip's estimate then counts like that of a window ([`fuse`](crate::fuse)). A vehicle that was parked in several
//! clips counts as one vehicle, and the prior counts once.

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{CameraEvidence, ParkedCar, bbox_iou, bbox_longer_side};

use crate::select::{MIN_KEYPOINTS, SAME_BAY};
use crate::{CONTRADICTS, CarIdentity, CarUse, FuseOptions, LinkId, WindowEstimate, fuse};

/// Result of comparing two pictures of the empty scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SameView {
    /// The camera has not moved.
    Same,
    /// The camera was turned or zoomed.
    Moved,
    /// The pictures cannot be compared: the light or the scene differs.
    Unknown,
}

/// Clips between which the camera was not moved.
#[derive(Clone, Debug)]
pub struct Epoch<'a> {
    /// Evidence of the clips, in order.
    pub clips: Vec<&'a CameraEvidence>,
    /// Estimate of each clip, in order; vehicles are linked across clips.
    pub windows: Vec<WindowEstimate>,
    /// The parked vehicles, each with its first observation.
    pub vehicles: Vec<(LinkId, &'a ParkedCar)>,
}

/// Largest number of an epoch's pictures that are compared, latest first. A site looks different by night and by day.
const PICTURES: usize = 12;
/// Largest rms distance between two keypoint sets of the same vehicle, as a share of the box's longer side.
///
/// The sets are first shifted and scaled onto each other. Nets err by about half of this; other car models differ by
/// more. In doubt the vehicle counts as the same one, which claims less information.
const SAME_SHAPE: f64 = 0.02;

/// Returns whether two parked vehicles are the same one in the same bay.
#[must_use]
pub fn same_vehicle(a: &ParkedCar, b: &ParkedCar) -> bool {
    if bbox_iou(&a.bbox_px, &b.bbox_px) < SAME_BAY {
        return false;
    }
    let common: Vec<(Vector2<f64>, Vector2<f64>)> = a
        .keypoints_px
        .iter()
        .zip(&b.keypoints_px)
        .filter_map(|(p, q)| Some((Vector2::from((*p)?), Vector2::from((*q)?))))
        .collect();
    let count = common.len() as f64;
    if count < MIN_KEYPOINTS {
        return true;
    }
    let (mean_p, mean_q) = common
        .iter()
        .fold((Vector2::zeros(), Vector2::zeros()), |(p, q), (x, y)| (p + x / count, q + y / count));
    let along: f64 = common.iter().map(|(p, q)| (p - mean_p).dot(&(q - mean_q))).sum();
    let spread: f64 = common.iter().map(|(p, _)| (p - mean_p).norm_squared()).sum();
    let scale = if spread > 0.0 { along / spread } else { 1.0 };
    let off: f64 =
        common.iter().map(|(p, q)| ((q - mean_q) - (p - mean_p) * scale).norm_squared()).sum::<f64>() / count;
    let side = bbox_longer_side(&b.bbox_px);
    off.sqrt() <= SAME_SHAPE * side
}

/// Returns the epochs of a camera, in the order of their first clips.
///
/// If a clip has several pieces of evidence, the last one counts. The function `compare` compares the pictures of two
/// clips.
#[must_use]
pub fn epochs<'a>(
    evidence: &'a [CameraEvidence],
    compare: &dyn Fn(&CameraEvidence, &CameraEvidence) -> SameView,
    options: &FuseOptions,
) -> Vec<Epoch<'a>> {
    let mut clips: Vec<&CameraEvidence> = evidence.iter().collect();
    clips.sort_by(|a, b| a.clip.cmp(&b.clip));
    let counts = |i: usize| clips[i + 1..].iter().all(|later| later.clip.sha256 != clips[i].clip.sha256);
    let counted: Vec<&CameraEvidence> = (0..clips.len()).filter(|i| counts(*i)).map(|i| clips[i]).collect();
    let mut epochs: Vec<Epoch<'a>> = Vec::new();
    let mut last_link: LinkId = 0;
    for clip in counted {
        let at = joins(clip, &epochs, compare, options).unwrap_or_else(|| {
            epochs.push(Epoch { clips: Vec::new(), windows: Vec::new(), vehicles: Vec::new() });
            epochs.len() - 1
        });
        epochs[at].add(clip, &mut last_link);
    }
    epochs
}

/// Returns the index of the epoch to which a clip belongs; `None` where it begins a new one.
///
/// This is the latest epoch with the same picture. If pictures do not decide, it is the epoch that the clip's numbers
/// fit best.
#[must_use]
pub fn joins(
    clip: &CameraEvidence,
    epochs: &[Epoch<'_>],
    compare: &dyn Fn(&CameraEvidence, &CameraEvidence) -> SameView,
    options: &FuseOptions,
) -> Option<usize> {
    let mut unseen = Vec::new();
    for (index, epoch) in epochs.iter().enumerate().rev() {
        if epoch.clips.first().is_none_or(|first| first.image_size_px != clip.image_size_px) {
            continue;
        }
        let mut moved = false;
        for other in epoch.clips.iter().rev().take(PICTURES) {
            match compare(clip, other) {
                SameView::Same => return Some(index),
                SameView::Moved => moved = true,
                SameView::Unknown => {}
            }
        }
        if !moved {
            unseen.push(index);
        }
    }
    let fits = unseen.into_iter().filter_map(|index| Some((index, epochs[index].fit(clip, options)?)));
    fits.reduce(|best, next| if next.1 > best.1 { next } else { best }).map(|(index, _)| index)
}

impl<'a> Epoch<'a> {
    /// Adds a clip and links its parked vehicles to those of the epoch. `last_link` is the last identifier in use.
    fn add(&mut self, clip: &'a CameraEvidence, last_link: &mut LinkId) {
        let mut cars: Vec<CarUse> = Vec::new();
        let mut fresh = || {
            *last_link += 1;
            *last_link
        };
        for car in &clip.parked {
            let known = self.vehicles.iter().find(|(_, stored)| same_vehicle(stored, car));
            let link = known.map_or_else(&mut fresh, |(link, _)| *link);
            if known.is_none() {
                self.vehicles.push((link, car));
            }
            cars.push(CarUse { car: CarIdentity::Stored(link), parked: true });
        }
        cars.extend((0..clip.moving).map(|_| CarUse { car: CarIdentity::Stored(fresh()), parked: false }));
        self.windows.push(WindowEstimate {
            span_s: [self.clips.len() as f64; 2],
            frames: clip.frames,
            params: clip.camera_params(),
            joint: clip.joint(),
            cars,
            position: 0,
        });
        self.clips.push(clip);
    }

    /// Returns the log likelihood of a clip's numbers given the epoch; `None` where they contradict each other.
    fn fit(&self, clip: &CameraEvidence, options: &FuseOptions) -> Option<f64> {
        let known = fuse(&self.windows, options).pop()?;
        // Numbers without evidence in the clip get a large, but finite, variance.
        let weak = Matrix4::from_diagonal(&options.prior_sd.map(|sd| 1e-4 / (sd * sd)));
        let own = (clip.joint().information + weak).try_inverse()?;
        let cholesky = (own + known.covariance).cholesky()?;
        let away: Vector4<f64> = clip.camera_params().to_vector() - known.params.to_vector();
        let distance = away.dot(&cholesky.solve(&away));
        (distance <= CONTRADICTS).then(|| -0.5 * (distance + cholesky.ln_determinant()))
    }
}
