//! Finds where the reference pictures of a clip lie.
//!
//! All homographies are those of undistorted pixels: the lens is known before ([`crate::LensView`]).
//!
//! The watcher registers each picture on one or two earlier pictures, its references
//! ([`roadplane_base::Registration`]). A picture on two references links them. References that are linked, directly or
//! through others, show one *place*. All pixels of a place are converted to those of its first reference, the *world*
//! picture.

use std::collections::{BTreeMap, BTreeSet};

use roadplane_base::{FrameRecord, Homography, ImageSize, Lens, PictureMotion, Registration};

use crate::adjust::{MeasuredLink, adjusted};
use crate::turns::{LEAST_SD_PX, Misfit, Turns};

/// Least time for which pictures must lie on the references of a place, s. A flash or a lorry in front of the camera is
/// shorter. So are the places that a camera passes at 8 m/s: rendered, they last for up to 1.3 s.
pub(crate) const MIN_PLACE_S: f64 = 2.0;
/// Least number of pictures on the references of a place.
const MIN_PICTURES: u64 = 4;

/// Weighted sum of the measurements of one link.
#[derive(Clone, Copy, Debug, Default)]
struct Link {
    numbers: [f64; 8],
    weight: f64,
}

/// The pictures that lie on one reference.
#[derive(Clone, Copy, Debug)]
struct Pictures {
    count: u64,
    first_s: f64,
    last_s: f64,
}

/// Collects the registrations of a clip, frame by frame. Its memory grows with the number of references alone.
#[derive(Clone, Debug, Default)]
pub struct PlacesBuilder {
    lens: Lens,
    /// Distortion at half the picture's width for the focal length from turns, and its sd (dimensionless).
    turned: [f64; 2],
    /// Homography from the first reference to the second.
    links: BTreeMap<(u64, u64), Link>,
    pictures: BTreeMap<u64, Pictures>,
    /// Misfits with the distortion `turned`, and with one that is greater by its sd.
    misfits: BTreeMap<u64, [Misfit; 2]>,
    size: Option<ImageSize>,
}

impl PlacesBuilder {
    /// Creates a builder for a clip with this lens. `turned` is the mean and sd of the distortion ([`Lens::distortion`])
    /// that the turns of the camera show. Only this is used for the focal length from turns. Edges that are curved in the
    /// world would make it wrong by more than its sd.
    #[must_use]
    pub fn new(lens: Lens, turned: [f64; 2]) -> Self {
        Self { lens, turned, ..Self::default() }
    }

    /// Takes the next frame.
    pub fn push(&mut self, frame: &FrameRecord) {
        let Some(watch) = frame.watch.as_ref().filter(|watch| watch.looked) else { return };
        let size = frame.image_size_px;
        self.size = Some(size);
        if let Some(registration) = watch.motion.first() {
            let misfits = self.misfits.entry(registration.reference).or_default();
            let [mean, sd] = self.turned;
            for (misfit, distortion) in misfits.iter_mut().zip([mean, mean + sd]) {
                misfit.add(registration, distortion, size);
            }
        }
        let distortion = self.lens.distortion(size);
        for (i, a) in watch.motion.iter().enumerate() {
            let time_s = frame.time_s;
            let start = Pictures { count: 0, first_s: time_s, last_s: time_s };
            let here = self.pictures.entry(a.reference).or_insert(start);
            (here.count, here.last_s) = (here.count + 1, here.last_s.max(time_s));
            for b in watch.motion.iter().skip(i + 1).filter(|b| b.reference != a.reference) {
                let (from, to) = if a.reference < b.reference { (a, b) } else { (b, a) };
                let link = from.homography_for(distortion).then(&to.homography_for(distortion).inverse());
                let variance = a.sd_px.powi(2) + b.sd_px.powi(2) + LEAST_SD_PX.powi(2);
                let sum = self.links.entry((from.reference, to.reference)).or_default();
                sum.weight += variance.recip();
                sum.numbers.iter_mut().zip(link.numbers()).for_each(|(sum, n)| *sum += n / variance);
            }
        }
    }

    /// Returns the places of the clip.
    #[must_use]
    pub fn finish(mut self) -> Places {
        let Some(size) = self.size else { return Places { lens: self.lens, ..Places::default() } };
        let is_measured = !self.pictures.is_empty();
        // A camera that is carried along shows no place: parallax makes its pictures differ.
        let of_travels = self.misfits.iter().filter(|(_, [misfit, _])| misfit.is_travelling());
        let travelling: BTreeSet<u64> = of_travels.map(|(reference, _)| *reference).collect();
        self.pictures.retain(|reference, _| !travelling.contains(reference));
        let links = self.mean_links();
        let mut open: BTreeSet<u64> = self.pictures.keys().copied().collect();
        let mut found: Vec<BTreeMap<u64, Homography>> = Vec::new();
        while let Some(first) = open.pop_first() {
            let mut place = BTreeMap::from([(first, Homography::IDENTITY)]);
            // The strongest link to a reference that has no position yet gives it one (Prim 1957).
            while let Some((reference, position)) = next_of(&place, &open, &links) {
                open.remove(&reference);
                place.insert(reference, position);
            }
            found.push(adjusted(place, &links, first, size));
        }
        let count_of =
            |place: &BTreeMap<u64, Homography>| place.keys().map(|r| self.pictures[r].count).sum::<u64>();
        let most = found.iter().map(count_of).max();
        found.retain(|place| {
            let here = || place.keys().map(|reference| &self.pictures[reference]);
            let first_s = here().map(|pictures| pictures.first_s).fold(f64::INFINITY, f64::min);
            let last_s = here().map(|pictures| pictures.last_s).fold(f64::NEG_INFINITY, f64::max);
            let lasts = last_s - first_s >= MIN_PLACE_S && count_of(place) >= MIN_PICTURES;
            lasts || Some(count_of(place)) == most
        });
        let turns = found.iter().enumerate().filter_map(|(i, place)| Some((i, self.turns_at(place, size)?)));
        let turns = turns.collect();
        let numbered = found.into_iter().enumerate();
        let references = numbered
            .flat_map(|(place, references)| {
                references.into_iter().map(move |(reference, reference_from_world)| {
                    (reference, Placed { place, reference_from_world })
                })
            })
            .collect();
        Places { lens: self.lens, references, travelling, is_measured, turns }
    }

    /// Returns the focal length from the turns at a place; `None` if they do not determine it.
    fn turns_at(&self, place: &BTreeMap<u64, Homography>, size: ImageSize) -> Option<Turns> {
        let [found, changed] = [0, 1].map(|which| {
            let mut all = Misfit::default();
            for (reference, reference_from_world) in place {
                if let Some(misfits) = self.misfits.get(reference) {
                    all.join(&misfits[which], reference_from_world, size);
                }
            }
            all.solve(size)
        });
        let (found, changed) = (found?, changed?);
        let by_lens = (changed.focal_px / found.focal_px).ln();
        Some(Turns { log_sd: found.log_sd.hypot(by_lens), ..found })
    }

    /// Returns the mean of the measurements of each link. A link whose mean has no inverse is left out.
    fn mean_links(&self) -> Vec<MeasuredLink> {
        let mean = |(&(from, to), Link { numbers, weight }): (&(u64, u64), &Link)| {
            let mapping = Homography::from_numbers(numbers.map(|n| n / weight))?;
            Some(MeasuredLink { ends: [from, to], mapping, weight: *weight })
        };
        self.links.iter().filter_map(mean).collect()
    }
}

/// Returns the reference with the strongest link to a place, and its position.
fn next_of(
    place: &BTreeMap<u64, Homography>,
    open: &BTreeSet<u64>,
    links: &[MeasuredLink],
) -> Option<(u64, Homography)> {
    let leads = |from: u64, to: u64| place.contains_key(&from) && open.contains(&to);
    let outward = links.iter().filter(|MeasuredLink { ends: [a, b], .. }| leads(*a, *b) || leads(*b, *a));
    // Of links with the same weight the first one counts.
    let link = outward.reduce(|best, next| if next.weight > best.weight { next } else { best })?;
    let [a, b] = link.ends;
    let (from, to, step) = if leads(a, b) { (a, b, link.mapping) } else { (b, a, link.mapping.inverse()) };
    Some((to, place[&from].then(&step)))
}

/// A reference and its position in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Index of the place, from 0.
    pub place: usize,
    /// Mapping from the world picture of the place to the reference, px.
    pub reference_from_world: Homography,
}

/// The places of a clip and the position of each reference.
#[derive(Clone, Debug, Default)]
pub struct Places {
    lens: Lens,
    references: BTreeMap<u64, Placed>,
    /// References whose pictures show that the camera is carried along.
    pub(crate) travelling: BTreeSet<u64>,
    /// Whether the motion of the camera was measured. Files of older versions and of other tools lack it.
    pub is_measured: bool,
    /// Focal length from the turns of the camera, by place. Places without such turns are missing.
    pub turns: BTreeMap<usize, Turns>,
}

impl Places {
    /// Returns the place that a registered picture shows, and the mapping from its world picture to the picture; `None`
    /// if the reference shows no place for long enough.
    #[must_use]
    pub fn position(&self, registration: &Registration, size: ImageSize) -> Option<(usize, PictureMotion)> {
        let placed = self.references.get(&registration.reference)?;
        let picture_from_reference = registration.homography_for(self.lens.distortion(size));
        let homography = placed.reference_from_world.then(&picture_from_reference);
        Some((placed.place, PictureMotion::new(homography, self.lens, size)))
    }
}
