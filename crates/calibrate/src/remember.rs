//! Evidence of many clips of one camera → epochs, in each of which the camera hung as it did.
//!
//! What is kept is the set of the clips' evidence; everything else follows from the set alone. Clips are taken in the order of
//! their [`ClipIdentity`](roadplane_base::ClipIdentity), each joins an epoch or begins one. A clip's estimate then counts as a
//! window's does ([`fuse`](crate::fuse)): a vehicle that was parked in several of them is one vehicle, and the prior is counted
//! once.

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{CameraEvidence, ParkedCar, bbox_iou};

use crate::{CarUse, FuseOptions, LinkId, SegmentStart, WindowEstimate, fuse};

/// What two pictures of the empty place say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SameView {
    /// The camera hangs as it did.
    Same,
    /// It was turned or zoomed.
    Moved,
    /// They cannot be compared: another light, another place.
    Unknown,
}

/// Clips between which the camera was not moved.
#[derive(Clone, Debug)]
pub struct Epoch<'a> {
    /// Their evidence, in order.
    pub clips: Vec<&'a CameraEvidence>,
    /// What each says, in order, vehicles linked across them.
    pub windows: Vec<WindowEstimate>,
    /// The vehicles that were parked, as they were first seen.
    pub vehicles: Vec<(LinkId, &'a ParkedCar)>,
}

/// Squared Mahalanobis distance (4 degrees of freedom) beyond which a clip contradicts an epoch: once in 2·10⁵ by chance.
const CONTRADICTS: f64 = 30.0;
/// Pictures of an epoch that are compared, the latest first: by night and by day a place looks different.
const PICTURES: usize = 12;
/// Boxes of the same vehicle overlap by at least this (intersection over union): it came back to its bay.
const SAME_BAY: f64 = 0.6;
/// Keypoints of the same vehicle, shifted and scaled onto each other, are as far apart at most, root mean square, as a share of
/// the box's longer side. Nets err by about half of it; other models are off by more. In doubt it is the same one, which claims
/// less.
const SAME_SHAPE: f64 = 0.02;
/// Keypoints that must be seen in both to tell vehicles apart.
const MIN_COMMON: usize = 6;

/// Whether two parked vehicles are the same one in the same bay.
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
    if common.len() < MIN_COMMON {
        return true;
    }
    let count = common.len() as f64;
    let (mean_p, mean_q) = common
        .iter()
        .fold((Vector2::zeros(), Vector2::zeros()), |(p, q), (x, y)| (p + x / count, q + y / count));
    let along: f64 = common.iter().map(|(p, q)| (p - mean_p).dot(&(q - mean_q))).sum();
    let spread: f64 = common.iter().map(|(p, _)| (p - mean_p).norm_squared()).sum();
    let scale = if spread > 0.0 { along / spread } else { 1.0 };
    let off: f64 =
        common.iter().map(|(p, q)| ((q - mean_q) - (p - mean_p) * scale).norm_squared()).sum::<f64>() / count;
    let side = (b.bbox_px[2] - b.bbox_px[0]).max(b.bbox_px[3] - b.bbox_px[1]);
    off.sqrt() <= SAME_SHAPE * side
}

/// Epochs of a camera, in the order of their first clips. Of several evidences of one clip the last given counts; `look` compares
/// two clips' pictures.
#[must_use]
pub fn epochs<'a>(
    evidence: &'a [CameraEvidence],
    look: &dyn Fn(&CameraEvidence, &CameraEvidence) -> SameView,
    options: &FuseOptions,
) -> Vec<Epoch<'a>> {
    let mut clips: Vec<&CameraEvidence> = evidence.iter().collect();
    clips.sort_by(|a, b| a.clip.cmp(&b.clip));
    let counts = |i: usize| clips[i + 1..].iter().all(|later| later.clip.sha256 != clips[i].clip.sha256);
    let counted: Vec<&CameraEvidence> = (0..clips.len()).filter(|i| counts(*i)).map(|i| clips[i]).collect();
    let mut epochs: Vec<Epoch<'a>> = Vec::new();
    let mut next_link: LinkId = 0;
    for clip in counted {
        let at = joins(clip, &epochs, look, options).unwrap_or_else(|| {
            epochs.push(Epoch { clips: Vec::new(), windows: Vec::new(), vehicles: Vec::new() });
            epochs.len() - 1
        });
        epochs[at].add(clip, &mut next_link);
    }
    epochs
}

/// Which epoch a clip belongs to: the latest whose picture is the same; else, where pictures say nothing, the one that its numbers
/// fit best. `None` begins a new one.
#[must_use]
pub fn joins(
    clip: &CameraEvidence,
    epochs: &[Epoch<'_>],
    look: &dyn Fn(&CameraEvidence, &CameraEvidence) -> SameView,
    options: &FuseOptions,
) -> Option<usize> {
    let mut unseen = Vec::new();
    for (index, epoch) in epochs.iter().enumerate().rev() {
        if epoch.clips.first().is_none_or(|first| first.image_size_px != clip.image_size_px) {
            continue;
        }
        let mut moved = false;
        for other in epoch.clips.iter().rev().take(PICTURES) {
            match look(clip, other) {
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
    fn add(&mut self, clip: &'a CameraEvidence, next_link: &mut LinkId) {
        let mut cars: Vec<CarUse> = Vec::new();
        let mut fresh = || {
            *next_link += 1;
            *next_link
        };
        for car in &clip.parked {
            let known = self.vehicles.iter().find(|(_, known)| same_vehicle(known, car));
            let link = known.map_or_else(&mut fresh, |(link, _)| *link);
            if known.is_none() {
                self.vehicles.push((link, car));
            }
            cars.push(CarUse { link, parked: true });
        }
        cars.extend((0..clip.moving).map(|_| CarUse { link: fresh(), parked: false }));
        self.windows.push(WindowEstimate {
            span_s: [self.clips.len() as f64; 2],
            frames: clip.frames,
            params: clip.camera_params(),
            solved: clip.camera_params(),
            joint: clip.joint(),
            cars,
            segment: 0,
            start: SegmentStart::Clip,
            steady: true,
        });
        self.clips.push(clip);
    }

    /// Log likelihood of a clip's numbers given the epoch's; `None` where they contradict each other.
    fn fit(&self, clip: &CameraEvidence, options: &FuseOptions) -> Option<f64> {
        let known = fuse(&self.windows, options).pop()?;
        // What the clip says nothing of gets a loose, not an infinite, variance.
        let weak = Matrix4::from_diagonal(&options.prior.sd.map(|sd| 1e-4 / (sd * sd)));
        let own = (clip.joint().information + weak).try_inverse()?;
        let factor = (own + known.covariance).cholesky()?;
        let away: Vector4<f64> = clip.camera_params().to_vector() - known.params.to_vector();
        let distance = away.dot(&factor.solve(&away));
        (distance <= CONTRADICTS).then(|| -0.5 * (distance + factor.ln_determinant()))
    }
}
