//! Follows a camera that turns or zooms: registers each picture on pictures of the place.
//!
//! The pictures of the place are *keyframes*. A picture is registered on the nearest one. Where the camera turns too far
//! for it, the picture becomes the next keyframe. It is registered on both, so the estimation can chain them
//! ([`roadplane_base::Registration`]). When the camera comes back, the earlier keyframe is used again.
//!
//! A picture that lies on no known keyframe starts a new one. So after a cut, the registrations form another chain. The
//! estimation decides which chains show a place for long enough.

use nalgebra::Vector2;
use roadplane_base::{FrameStamp, Homography, ImageSize, PictureMotion, RegisteredLens, Registration};

use crate::reference::{Prepared, Reference};
use crate::registration::{Fit, LensMean, Registered, picture_box};
use crate::search::{refined, search};
use crate::view::NOT_DISPLACED_PX;
use crate::{SmallGrey, View};

/// Smallest number of blocks with structure that a keyframe needs.
const MIN_BLOCKS: usize = 12;
/// Largest displacement of a picture on its keyframe, as a share of the picture's width. At this displacement, three
/// quarters of the picture lie on the keyframe.
const MAX_SHIFT: f64 = 0.2;
/// Largest absolute logarithm of the scale of a picture on its keyframe. At this scale, the resolutions of both pictures
/// differ by a quarter.
const MAX_LOG_SCALE: f64 = 0.22;
/// Largest roll of a picture on its keyframe, rad. At this roll, the corners are displaced as by [`MAX_SHIFT`].
const MAX_ROLL: f64 = 0.35;
/// Another keyframe replaces the current one if the picture lies nearer to it by this factor.
const NEARER: f64 = 0.6;
/// Largest displacement between the position that a chain of keyframes predicts and the measured one, px of the reduced
/// picture. On 30 rendered pans, links have errors of 0.1 px, and wrong registrations have errors of 1 px and more.
const CHAIN_ERROR: f64 = 1.0;
/// Largest displacement at which the keyframe adapts to the picture, as a share of the picture's width.
const FOLLOWED_SHIFT: f64 = 0.05;
/// Step of the distortion by which the change of a homography is converted to pixels of the frame (dimensionless).
const DISTORTION_STEP: f64 = 1e-3;
/// Largest number of keyframes. The one that was used least recently is dropped.
const MAX_KEYFRAMES: usize = 24;
/// Number of keyframes that are tried first when the camera is lost, the most recently used first.
const TRIED_AT_ONCE: usize = 3;

/// A picture of the place.
#[derive(Clone, Debug)]
struct Keyframe {
    /// Index of its frame.
    frame: u64,
    reference: Reference,
    /// Mapping between undistorted pixels from the first keyframe of its chain, px of the reduced picture from its middle.
    from_chain: Homography,
    /// Chain of keyframes that it belongs to.
    chain: u64,
    /// Last picture that was registered on it, and its number.
    last: (PictureMotion, u64),
}

/// Where a picture lies in a place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose {
    /// Index of the frame of the keyframe on which the picture was registered.
    keyframe: u64,
    /// Mapping between undistorted pixels from the keyframe to the picture, px of the reduced picture from its middle.
    picture_from_keyframe: Homography,
}

/// The keyframes of a place, and the position of the last picture on them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panorama {
    /// Keyframes, the most recently used last.
    keyframes: Vec<Keyframe>,
    /// Number of pictures so far.
    pictures: u64,
    /// Motion of the undistorted picture from the one before the last to the last one.
    step: Option<Homography>,
    /// Keyframe that is searched for next when the camera is lost.
    next_searched: usize,
    /// Whether the place has shown too little structure for a keyframe.
    is_bare: bool,
    /// Mean distortion of the lens that the pictures so far show.
    lens: LensMean,
}

impl Panorama {
    /// Registers the next picture. The first entry of the result is the most accurate one.
    pub(crate) fn register(
        &mut self,
        stamp: FrameStamp,
        small: &SmallGrey,
        picture: &Prepared,
    ) -> Vec<Registration> {
        self.pictures += 1;
        let size = (small.width, small.height);
        if self.keyframes.first().is_some_and(|keyframe| keyframe.reference.fine().size() != size) {
            self.keyframes.clear();
        }
        let mut out = Vec::new();
        let mut shown = self.lens;
        let mut found = |keyframe: &Keyframe, fit: &Fit| {
            shown.add(fit);
            out.push(registration(keyframe.frame, fit, small));
        };
        match self.follow(stamp, picture) {
            Some((fit, is_young)) => {
                let mut here = None;
                if is_young {
                    here = self.recover(picture);
                }
                let current = self.keyframes.len() - 1;
                if let Some((keyframe, home)) = here {
                    // The lost place is found again. Both registrations are kept, as they link the keyframes.
                    found(&self.keyframes[keyframe], &home);
                    found(&self.keyframes[current], &fit);
                    self.join(current, &fit, keyframe, &home);
                    self.use_keyframe(keyframe, &home);
                    self.lens = shown;
                    return out;
                }
                match self.nearer(&fit, picture) {
                    Some((other, own)) => {
                        found(&self.keyframes[other], &own);
                        found(&self.keyframes[current], &fit);
                        self.use_keyframe(other, &own);
                    }
                    None if farness(&fit.picture_from_reference, size) > 1.0 => {
                        // A new keyframe comes last, and the oldest one may be dropped.
                        let is_added = self.add(stamp, picture, Some(&fit));
                        let last = self.keyframes.len() - 1;
                        if is_added {
                            found(&self.keyframes[last], &Fit::OWN);
                        }
                        found(&self.keyframes[last - usize::from(is_added)], &fit);
                    }
                    None => found(&self.keyframes[current], &fit),
                }
            }
            None => {
                self.step = None;
                if let Some((keyframe, fit)) = self.recover(picture) {
                    found(&self.keyframes[keyframe], &fit);
                    self.use_keyframe(keyframe, &fit);
                } else if self.add(stamp, picture, None) {
                    found(&self.keyframes[self.keyframes.len() - 1], &Fit::OWN);
                }
            }
        }
        self.lens = shown;
        out
    }

    /// Returns the pose of the last picture; `None` if it lies on no keyframe.
    pub(crate) fn pose(&self) -> Option<Pose> {
        let current = self.keyframes.last().filter(|current| current.last.1 == self.pictures)?;
        Some(Pose { keyframe: current.frame, picture_from_keyframe: current.last.0.homography })
    }

    /// Returns how the last picture, with these registrations, shows the current keyframe. `None` if it lies on no
    /// keyframe, though there is one.
    pub(crate) fn view(&self, registrations: &[Registration], size: ImageSize) -> Option<View> {
        if self.keyframes.is_empty() {
            return Some(View::new(None, PictureMotion::IDENTITY, size));
        }
        let Pose { keyframe, .. } = self.pose()?;
        let own = registrations.iter().find(|registration| registration.reference == keyframe);
        let motion = own.map_or(PictureMotion::IDENTITY, |own| own.picture_from_reference(size));
        Some(View::new(Some(keyframe), motion, size))
    }

    /// Returns the motion of the undistorted picture from one pose to another, px of the reduced picture from its
    /// middle. `None` if nothing links the two, or if one of their keyframes was dropped.
    pub(crate) fn between(&self, from: &Pose, to: &Pose) -> Option<Homography> {
        if from.keyframe == to.keyframe {
            return Some(from.picture_from_keyframe.inverse().then(&to.picture_from_keyframe));
        }
        let keyframe = |pose: &Pose| self.keyframes.iter().find(|keyframe| keyframe.frame == pose.keyframe);
        let (a, b) = (keyframe(from)?, keyframe(to)?);
        let pose = |keyframe: &Keyframe, of: &Pose| keyframe.from_chain.then(&of.picture_from_keyframe);
        (a.chain == b.chain).then(|| pose(a, from).inverse().then(&pose(b, to)))
    }

    /// Registers a picture on the current keyframe. Also returns whether its chain is new, while others exist.
    fn follow(&mut self, stamp: FrameStamp, picture: &Prepared) -> Option<(Fit, bool)> {
        let is_young =
            |keyframe: &Keyframe, all: &[Keyframe]| all.iter().any(|other| other.chain < keyframe.chain);
        let step = self.step;
        let current = self.keyframes.last()?;
        let last = current.last.0;
        let predicted = step.map_or(last, |step| last.then(&step));
        let Registered { fit, shifts, laid } = current
            .reference
            .registered(picture, &predicted, &self.lens)
            .or_else(|| step.and_then(|_| current.reference.registered(picture, &last, &self.lens)))?;
        let is_young = is_young(current, &self.keyframes);
        let current = self.keyframes.last_mut()?;
        let size = current.reference.fine().size();
        let mapping = fit.picture_from_reference;
        let displaced = mapping.homography.displacement(&picture_box(size));
        if displaced < FOLLOWED_SHIFT * size.0 as f64 {
            let [fine, coarse] =
                laid.as_ref().map_or([picture.fine(), picture.coarse()], |laid| laid.each_ref());
            current.reference.follow([fine, coarse], &shifts, stamp.time_s());
        }
        self.step = Some(last.homography.inverse().then(&mapping.homography));
        current.last = (mapping, self.pictures);
        Some((fit, is_young))
    }

    /// Returns another keyframe of the chain on which the picture lies nearer, and its registration.
    fn nearer(&self, fit: &Fit, picture: &Prepared) -> Option<(usize, Fit)> {
        let (current, others) = self.keyframes.split_last()?;
        let size = current.reference.fine().size();
        let now = farness(&fit.picture_from_reference, size);
        if now < NEARER {
            return None;
        }
        let from_chain = current.from_chain.then(&fit.picture_from_reference.homography);
        let predicted = |keyframe: &Keyframe| PictureMotion {
            homography: keyframe.from_chain.inverse().then(&from_chain),
            ..fit.picture_from_reference
        };
        let (other, keyframe) =
            others.iter().enumerate().filter(|(_, keyframe)| keyframe.chain == current.chain).min_by(
                |(_, a), (_, b)| farness(&predicted(a), size).total_cmp(&farness(&predicted(b), size)),
            )?;
        if farness(&predicted(keyframe), size) > NEARER * now {
            return None;
        }
        let own = keyframe.reference.registered(picture, &predicted(keyframe), &self.lens)?.fit;
        // A fit elsewhere than the chain says is wrong: vehicles have left the keyframe, or cover it.
        let change = predicted(keyframe).homography.inverse().then(&own.picture_from_reference.homography);
        (change.displacement(&picture_box(size)) < CHAIN_ERROR).then_some((other, own))
    }

    /// Looks for the picture on the keyframes of other chains, or on all if the current one does not fit.
    fn recover(&mut self, picture: &Prepared) -> Option<(usize, Fit)> {
        let count = self.keyframes.len();
        let chain = self.keyframes.last()?.chain;
        let is_young = self.keyframes.iter().any(|other| other.chain != chain) && self.step.is_some();
        let candidates: Vec<usize> =
            (0..count).rev().filter(|i| !is_young || self.keyframes[*i].chain != chain).collect();
        for &i in candidates.iter().take(TRIED_AT_ONCE) {
            let keyframe = &self.keyframes[i];
            if let Some(found) = keyframe.reference.registered(picture, &keyframe.last.0, &self.lens) {
                return Some((i, found.fit));
            }
        }
        // A search costs more than all other steps. A lost picture is searched on the last keyframe, as a fast pan may
        // have begun, and each picture on one more keyframe.
        if !is_young && let Some(fit) = self.searched(count - 1, picture) {
            return Some((count - 1, fit));
        }
        let index = *candidates.get(self.next_searched % candidates.len().max(1))?;
        self.next_searched += 1;
        let is_searched = !is_young && index == count - 1;
        if is_searched { None } else { Some((index, self.searched(index, picture)?)) }
    }

    /// Looks for the picture on a keyframe, whatever its position.
    fn searched(&self, index: usize, picture: &Prepared) -> Option<Fit> {
        let reference = &self.keyframes[index].reference;
        let found = search(reference.fine(), picture.smooth())?;
        let size = reference.fine().size();
        let middle = Vector2::new(size.0 as f64, size.1 as f64) / 2.0;
        let carried = refined(reference.fine(), picture.smooth(), &found);
        let about = Homography::from(carried).in_coordinates(1.0, -middle);
        Some(reference.registered(picture, &about.into(), &self.lens)?.fit)
    }

    /// Makes a keyframe the current one, with the position of the current picture on it.
    fn use_keyframe(&mut self, index: usize, fit: &Fit) {
        let mut keyframe = self.keyframes.remove(index);
        let (last, picture) = keyframe.last;
        if picture + 1 == self.pictures {
            self.step = Some(last.homography.inverse().then(&fit.picture_from_reference.homography));
        }
        keyframe.last = (fit.picture_from_reference, self.pictures);
        self.keyframes.push(keyframe);
    }

    /// Joins the chain of the keyframe `young` to that of `old`. The same picture lies on both.
    fn join(&mut self, young: usize, young_fit: &Fit, old: usize, old_fit: &Fit) {
        let (from, to) = (self.keyframes[young].chain, self.keyframes[old].chain);
        let by_old = self.keyframes[old].from_chain.then(&old_fit.picture_from_reference.homography);
        let by_young = self.keyframes[young].from_chain.then(&young_fit.picture_from_reference.homography);
        let change = by_old.then(&by_young.inverse());
        for keyframe in self.keyframes.iter_mut().filter(|keyframe| keyframe.chain == from) {
            keyframe.from_chain = change.then(&keyframe.from_chain);
            keyframe.chain = to;
        }
    }

    /// Makes the picture a keyframe: of the current chain if `fit` is its position on the current keyframe, else of a new
    /// chain. Returns whether the picture has enough structure.
    fn add(&mut self, stamp: FrameStamp, picture: &Prepared, fit: Option<&Fit>) -> bool {
        let reference = Reference::new(picture);
        let has_structure = reference.fine().block_count() >= MIN_BLOCKS;
        // After pictures without structure, as of a bare road, a single car is not enough.
        if !has_structure || (self.is_bare && fit.is_none() && !reference.fine().is_structured_all_over()) {
            self.is_bare |= fit.is_none();
            return false;
        }
        self.is_bare = false;
        let (chain, from_chain) = match (self.keyframes.last(), fit) {
            (Some(current), Some(fit)) => {
                (current.chain, current.from_chain.then(&fit.picture_from_reference.homography))
            }
            _ => (stamp.index, Homography::IDENTITY),
        };
        let last = (PictureMotion::IDENTITY, self.pictures);
        self.keyframes.push(Keyframe { frame: stamp.index, reference, from_chain, chain, last });
        if self.keyframes.len() > MAX_KEYFRAMES {
            self.keyframes.remove(0);
        }
        true
    }
}

/// Returns the distance of a picture from its keyframe; above 1 the picture needs another one.
fn farness(mapping: &PictureMotion, size: (usize, usize)) -> f64 {
    let similarity = mapping.homography.similarity(&picture_box(size));
    let shift = mapping.homography.apply(&Vector2::zeros()).norm() / size.0 as f64;
    (shift / MAX_SHIFT)
        .max(similarity.log_scale().abs() / MAX_LOG_SCALE)
        .max(similarity.turn().abs() / MAX_ROLL)
}

/// Converts a fit to the record of a frame, px of the frame.
fn registration(frame: u64, fit: &Fit, small: &SmallGrey) -> Registration {
    let factor = small.factor as f64;
    let half_width = small.width as f64 / 2.0;
    // The middle of the top-left pixel is the origin of pixels.
    let middle = Vector2::new(small.width as f64, small.height as f64) * (factor / 2.0);
    let in_frame =
        |mapping: &Homography, scale: f64| mapping.in_coordinates(scale, middle.add_scalar(-0.5)).numbers();
    let PictureMotion { homography, lens, .. } = fit.picture_from_reference;
    let [distortion, sd] = fit.lens;
    let displaced = factor * homography.displacement(&picture_box((small.width, small.height)));
    let is_displaced = displaced >= NOT_DISPLACED_PX;
    // The change of the numbers is that of a small change of the distortion.
    let scaled = homography.in_coordinates(1.0 / half_width, Vector2::zeros()).numbers();
    let from_prior = distortion - lens.per_px2 * half_width * half_width;
    let changed = |step: f64| {
        let numbers = std::array::from_fn(|i| scaled[i] + step * fit.change[i]);
        Homography::from_numbers(numbers).map(|mapping| in_frame(&mapping, factor * half_width))
    };
    let change = match (changed(-DISTORTION_STEP), changed(DISTORTION_STEP)) {
        (Some(less), Some(more)) => std::array::from_fn(|i| (more[i] - less[i]) / (2.0 * DISTORTION_STEP)),
        _ => [0.0; 8],
    };
    let rounded = |value: f64, digits: f64| (value * digits).round() / digits + 0.0;
    let numbers = changed(from_prior).unwrap_or_else(|| in_frame(&homography, factor));
    Registration {
        reference: frame,
        homography: is_displaced.then(|| Homography::rounded(numbers)),
        sd_px: rounded(factor * fit.sd, 1e3),
        lens: is_displaced.then(|| RegisteredLens {
            bend: rounded(distortion, 1e5),
            sd: rounded(sd, 1e5),
            change: Homography::rounded(change),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the picture of a camera that was moved to the right by `moved` px over a wide scene of random texture.
    fn seen(moved: usize) -> SmallGrey {
        let (width, height) = (192, 128);
        let knot = |x: usize, y: usize| {
            let hash = (x * 7919 + y * 104_729 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            ((hash >> 40) % 200) as f64
        };
        let value = |x: usize, y: usize| {
            let ((column, u), (row, v)) = ((x / 8, (x % 8) as f64 / 8.0), (y / 8, (y % 8) as f64 / 8.0));
            let mix = |row: usize| knot(column, row) * (1.0 - u) + knot(column + 1, row) * u;
            (20.0 + mix(row) * (1.0 - v) + mix(row + 1) * v) as u8
        };
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let values = pixels.map(|(x, y)| value(x + moved, y)).collect();
        SmallGrey { width, height, factor: 1, values }
    }

    #[test]
    fn a_fast_pan_is_followed_from_its_beginning() {
        // The step is beyond the reach of a registration without a prediction. A cut precedes the pan.
        const STEP: usize = 24;
        const CUT: u64 = 3;
        let mut panorama = Panorama::default();
        for index in 0..40_u64 {
            let small = seen(if index < CUT { 9000 } else { STEP * index as usize });
            let stamp = FrameStamp { index, pts_nanos: 33_333_333 * index as i64 };
            panorama.register(stamp, &small, &Prepared::of(&small));
        }
        let chains: Vec<u64> = panorama.keyframes.iter().map(|keyframe| keyframe.chain).collect();
        assert!(chains.len() > 2 && chains.iter().all(|chain| [0, CUT].contains(chain)), "{chains:?}");
    }

    #[test]
    fn a_car_on_a_bare_road_is_no_place() {
        let mut panorama = Panorama::default();
        let register = |panorama: &mut Panorama, index: u64, small: &SmallGrey| {
            let stamp = FrameStamp { index, pts_nanos: 33_333_333 * index as i64 };
            panorama.register(stamp, small, &Prepared::of(small))
        };
        let scene = seen(0);
        let bare = SmallGrey { values: vec![90; scene.values.len()], ..scene.clone() };
        let mut car = bare.clone();
        for y in 40..100 {
            let row = y * car.width;
            car.values[row + 60..row + 130].copy_from_slice(&scene.values[row + 60..row + 130]);
        }
        let is_enough = Reference::new(&Prepared::of(&car)).fine().block_count() >= MIN_BLOCKS;
        assert!(is_enough, "the car alone has enough structure for a keyframe");
        assert!(register(&mut panorama, 0, &bare).is_empty());
        assert!((1..5).all(|index| register(&mut panorama, index, &car).is_empty()));
        assert_eq!(
            register(&mut panorama, 5, &scene).len(),
            1,
            "a picture with structure all over is a place"
        );
    }

    #[test]
    fn a_chain_longer_than_the_memory_keeps_its_links() {
        const STEP: usize = 3;
        let mut panorama = Panorama::default();
        let mut links = 0;
        let pictures = (MAX_KEYFRAMES + 6) * 40 / STEP;
        for index in 0..pictures as u64 {
            let small = seen(STEP * index as usize);
            let stamp = FrameStamp { index, pts_nanos: 33_333_333 * index as i64 };
            let found = panorama.register(stamp, &small, &Prepared::of(&small));
            assert!(!found.is_empty(), "frame {index} is lost");
            for registration in &found {
                let shift = registration.homography_for(0.0).apply(&Vector2::zeros());
                let truth = -((index - registration.reference) as f64) * STEP as f64;
                assert!((shift - Vector2::new(truth, 0.0)).norm() < 1.0, "frame {index}: {registration:?}");
            }
            links += usize::from(found.len() == 2);
        }
        assert!(links > MAX_KEYFRAMES && panorama.keyframes.len() == MAX_KEYFRAMES, "{links}");
    }
}
