//! Vehicles that were seen before: where each is expected, and whether it stands.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use roadplane_base::{CarRecord, VehicleClass, bbox_around, bbox_centre, bbox_iou, bbox_moved};

/// Looks in a row in which the box stayed where it was, after which nobody needs to look until something changes.
const SETTLED_LOOKS: u32 = 5;
/// … and time that they take at least, s.
const SETTLED_S: f64 = 0.35;
/// A vehicle in motion is looked at when it must have moved by this share of its box's diagonal …
const MOVED: f64 = 0.12;
/// … or was not seen for so long, s …
const UNSEEN_S: f64 = 0.2;
/// … and in every look while its score is lower: the next may not find it.
const DOUBTFUL: f64 = 0.5;
/// A box that overlaps its first place less (intersection over union) has moved …
const STAYED: f64 = 0.8;
/// … down to this where nothing changed: what drives leaves nothing as it was, it is the detector that wavers.
const STAYED_UNCHANGED: f64 = 0.5;
/// Looks in a row that may miss a vehicle …
const MAX_MISSED: f64 = 2.0;
/// … looks nearer than this to the one before err as it did and count in proportion, s …
const ALIKE_S: f64 = 0.09;
/// … and where nothing changed a miss counts so much: what stands does not leave unseen, it is the detector that wavers.
const MISSED_UNCHANGED: f64 = 0.25;
/// Share of the votes that makes a car; votes fade by a factor from look to look.
const CAR_SHARE: f64 = 0.3;
const FADE: f64 = 0.97;
/// Least overlap of a box with where it was expected, intersection over union.
const MIN_OVERLAP: f64 = 0.2;
/// What a look covers beside the box, as a share of its sides.
const AROUND: f64 = 0.15;

/// A vehicle seen before; boxes in px of the frame at rest.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    pub bbox_px: [f64; 4],
    pub score: f64,
    /// Scores of the looks that took it for each class.
    votes: BTreeMap<VehicleClass, f64>,
    /// Frame in which it was seen last.
    pub seen_frame: u64,
    seen_s: f64,
    /// Where it was when it began to stay.
    anchor_px: [f64; 4],
    anchor_s: f64,
    stayed: u32,
    /// Looks in which it was seen.
    looks: u32,
    missed: f64,
    /// When its place was looked at last, s.
    looked_s: f64,
    velocity_px_s: Vector2<f64>,
}

impl Known {
    fn new(found: &CarRecord, frame: u64, time_s: f64) -> Self {
        Self {
            bbox_px: found.bbox_px,
            score: found.score,
            votes: BTreeMap::from([(found.class, found.score)]),
            seen_frame: frame,
            seen_s: time_s,
            anchor_px: found.bbox_px,
            anchor_s: time_s,
            stayed: 1,
            looks: 1,
            missed: 0.0,
            looked_s: time_s,
            velocity_px_s: Vector2::zeros(),
        }
    }

    /// What it is: all looks have a say. The detector takes cars for trucks, cut ones above all, more often than trucks for cars.
    pub(crate) fn class(&self) -> VehicleClass {
        let all: f64 = self.votes.values().sum();
        if self.votes.get(&VehicleClass::Car).is_some_and(|votes| *votes >= CAR_SHARE * all) {
            return VehicleClass::Car;
        }
        let best = self.votes.iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
        best.map_or(VehicleClass::Car, |(class, _)| *class)
    }

    /// It stands, as far as looks go: its place needs none until something changes there. A detector that wavers over it is no
    /// reason to look more often than the sweep does.
    pub(crate) fn is_settled(&self) -> bool {
        self.stands() && self.missed < 1.0
    }

    /// It stayed where it is for long enough.
    fn stands(&self) -> bool {
        self.stayed >= SETTLED_LOOKS && self.seen_s - self.anchor_s >= SETTLED_S
    }

    /// Whether a look is due: it is new or was missed, it must have moved by now so much that a look tells something, or it was
    /// seen too long ago.
    pub(crate) fn is_due(&self, time_s: f64) -> bool {
        let [x0, y0, x1, y1] = self.bbox_px;
        let moved = self.velocity_px_s.norm() * (time_s - self.seen_s);
        self.looks < SETTLED_LOOKS
            || (self.score < DOUBTFUL && !self.is_held())
            || (self.missed > 0.0 && !self.is_held())
            || moved >= MOVED * (x1 - x0).hypot(y1 - y0)
            || time_s - self.looked_s >= UNSEEN_S
    }

    /// It stood, and too few looks missed it to say that it left: it is still taken to be there.
    pub(crate) fn is_held(&self) -> bool {
        self.stands() && self.missed < MAX_MISSED
    }

    /// Where it is expected.
    pub(crate) fn expected(&self, time_s: f64) -> [f64; 4] {
        if self.stands() {
            return self.bbox_px;
        }
        bbox_moved(&self.bbox_px, &(self.velocity_px_s * (time_s - self.seen_s).clamp(0.0, 0.5)))
    }

    /// What a look for it must cover: where it was, where it is expected, and a little around.
    pub(crate) fn place(&self, time_s: f64) -> [f64; 4] {
        let bbox = &self.bbox_px;
        let [x0, y0, x1, y1] = bbox_around(bbox, &self.expected(time_s));
        let (dx, dy) = (AROUND * (bbox[2] - bbox[0]), AROUND * (bbox[3] - bbox[1]));
        [x0 - dx, y0 - dy, x1 + dx, y1 + dy]
    }

    /// It was found in a look; where nothing changed (`unchanged`) a vehicle that stands keeps its box.
    fn seen(&mut self, found: &CarRecord, unchanged: bool, frame: u64, time_s: f64) {
        self.looks = self.looks.saturating_add(1);
        self.looked_s = time_s;
        self.votes.values_mut().for_each(|votes| *votes *= FADE);
        *self.votes.entry(found.class).or_default() += found.score;
        let least = if unchanged { STAYED_UNCHANGED } else { STAYED };
        let stays = bbox_iou(&self.anchor_px, &found.bbox_px) >= least;
        let keeps_box = unchanged && stays && self.is_held();
        let gap_s = time_s - self.seen_s;
        if !keeps_box && gap_s > 0.0 {
            self.velocity_px_s = (bbox_centre(&found.bbox_px) - bbox_centre(&self.bbox_px)) / gap_s;
        }
        if stays {
            self.stayed = self.stayed.saturating_add(1);
        } else {
            (self.anchor_px, self.anchor_s, self.stayed) = (found.bbox_px, time_s, 1);
        }
        if !keeps_box {
            self.bbox_px = found.bbox_px;
        }
        self.score = found.score;
        (self.seen_frame, self.seen_s, self.missed) = (frame, time_s, 0.0);
    }
}

/// Tells which of the vehicles `found` in a look are known, gives those that stand where nothing changed the box that they have,
/// and forgets those that looks keep missing. `covers` says whether a box was looked at as a whole, `unchanged` whether nothing
/// changed in it.
pub(crate) fn update(
    known: &mut Vec<Known>,
    found: &mut [CarRecord],
    frame: u64,
    time_s: f64,
    covers: impl Fn(&[f64; 4]) -> bool,
    unchanged: impl Fn(&[f64; 4]) -> bool,
) {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (k, vehicle) in known.iter().enumerate() {
        let expected = vehicle.expected(time_s);
        for (f, car) in found.iter().enumerate() {
            let overlap = bbox_iou(&expected, &car.bbox_px).max(bbox_iou(&vehicle.bbox_px, &car.bbox_px));
            if overlap >= MIN_OVERLAP {
                pairs.push((overlap, k, f));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut of_known, mut of_found) = (vec![false; known.len()], vec![false; found.len()]);
    for (_, k, f) in pairs {
        if !of_known[k] && !of_found[f] {
            (of_known[k], of_found[f]) = (true, true);
            let is_unchanged = unchanged(&known[k].bbox_px);
            known[k].seen(&found[f], is_unchanged, frame, time_s);
            (found[f].bbox_px, found[f].class) = (known[k].bbox_px, known[k].class());
        }
    }
    for (vehicle, seen) in known.iter_mut().zip(&of_known) {
        if !seen && covers(&vehicle.expected(time_s)) {
            let miss = ((time_s - vehicle.looked_s) / ALIKE_S).min(1.0);
            vehicle.missed += if unchanged(&vehicle.bbox_px) { MISSED_UNCHANGED * miss } else { miss };
            vehicle.looked_s = time_s;
        }
    }
    known.retain(|vehicle| vehicle.missed < MAX_MISSED);
    known.extend(
        found.iter().zip(&of_found).filter(|(_, known)| !**known).map(|(f, _)| Known::new(f, frame, time_s)),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(x: f64) -> CarRecord {
        CarRecord::boxed([x, 100.0, x + 80.0, 150.0])
    }

    #[test]
    fn what_stays_settles_and_what_is_missed_twice_is_forgotten() {
        let mut known = Vec::new();
        for look in 0..5_u32 {
            assert!(!known.iter().any(Known::is_settled));
            let mut found = [car(10.0 + f64::from(look % 2))];
            update(&mut known, &mut found, look.into(), f64::from(look) * 0.1, |_| true, |_| false);
        }
        assert!(known[0].is_settled() && known.len() == 1);
        let mut jittering = [car(13.0)];
        update(&mut known, &mut jittering, 5, 0.5, |_| true, |_| true);
        assert!((jittering[0].bbox_px[0] - 10.0).abs() < 1e-9, "it keeps its box");
        let mut look = |frame: u64, covers: bool| {
            update(&mut known, &mut [], frame, frame as f64 * 0.1, |_| covers, |_| frame < 8);
            (
                known.len(),
                known.first().is_some_and(Known::is_settled),
                known.first().is_some_and(Known::is_held),
            )
        };
        assert_eq!(look(6, false), (1, true, true), "nobody looked");
        assert_eq!(look(7, true), (1, true, true), "nothing changed: the detector wavers");
        assert_eq!(look(8, true), (1, false, true), "one miss may be the detector's");
        assert_eq!(look(9, true).0, 0);
    }

    #[test]
    fn what_drives_is_expected_farther_on_and_never_settles() {
        let mut known = Vec::new();
        for look in 0..12_u32 {
            let mut found = [car(f64::from(look) * 20.0)];
            update(&mut known, &mut found, look.into(), f64::from(look) * 0.1, |_| true, |_| false);
        }
        assert!(known.len() == 1 && !known[0].is_settled());
        assert!((known[0].expected(1.2)[0] - 240.0).abs() < 1e-6);
        assert!(!known[0].is_due(1.11) && known[0].is_due(1.2), "20 px are much of its 94 px, 2 are not");
    }

    #[test]
    fn a_doubtful_vehicle_is_looked_for_in_every_look_and_not_given_up_sooner() {
        let doubtful = |x: f64| CarRecord { score: 0.4, ..car(x) };
        let mut known = Vec::new();
        for look in 0..12_u32 {
            let mut found = [doubtful(f64::from(look) * 20.0)];
            update(&mut known, &mut found, look.into(), f64::from(look) * 0.1, |_| true, |_| false);
        }
        assert!(known[0].is_due(1.11));
        let missed_for_s = (1..20)
            .map(|i| f64::from(i) / 30.0)
            .find(|gone_s| {
                update(&mut known, &mut [], 13, 1.1 + gone_s, |_| true, |_| false);
                known.is_empty()
            })
            .unwrap();
        assert!(
            (0.15..0.25).contains(&missed_for_s),
            "looks 1/30 s apart are not so many chances: {missed_for_s}"
        );
    }

    #[test]
    fn a_box_that_jitters_where_nothing_changes_stands() {
        let mut known = Vec::new();
        for look in 0..6_u32 {
            let mut found = [car(if look % 2 == 0 { 10.0 } else { 26.0 })];
            update(&mut known, &mut found, look.into(), f64::from(look) * 0.1, |_| true, |_| true);
        }
        assert!(known[0].is_settled(), "two thirds of its box stayed");
    }
}
