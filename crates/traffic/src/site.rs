//! The clips of one camera with their gates and zones, and the periods of its tables.

use roadplane_base::VehicleClass;

use crate::clock::Clock;
use crate::records::Group;
use crate::{Clip, Gate, Lane, Zone};

/// The clips of one camera, each with its gates and zones.
#[derive(Clone, Debug)]
pub struct Site {
    /// Name of the camera.
    pub name: String,
    /// The clips. Either all of them have a start, or there is only one.
    pub clips: Vec<SiteClip>,
    /// Lanes in the world frame that all clips share; empty if they are not known.
    pub lanes: Vec<Lane>,
}

/// A clip with gates and zones in its world frame. All clips of a camera have the same names of gates and zones.
#[derive(Clone, Debug)]
pub struct SiteClip {
    /// Vehicles of the clip.
    pub clip: Clip,
    /// Gates in the world frame of the clip.
    pub gates: Vec<Gate>,
    /// Zones in the world frame of the clip.
    pub zones: Vec<Zone>,
}

/// A period of the tables, in s of the camera's time: s since 1970 if the clips have a start, or s in the clip.
#[derive(Clone, Debug)]
pub(crate) struct Period {
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    pub(crate) followed_s: f64,
    pub(crate) labels: [String; 2],
}

impl SiteClip {
    /// Returns the time of the clip's time 0 in the camera's time, s.
    pub(crate) fn offset_s(&self) -> f64 {
        self.clip.start_s.unwrap_or(0.0)
    }

    /// Whether the tracks have sds.
    pub(crate) fn has_sds(&self) -> bool {
        self.clip.scale_sd.is_some()
    }
}

impl Site {
    /// Returns the periods that overlap a clip.
    pub(crate) fn periods(&self, clock: &Clock) -> Vec<Period> {
        let dated = self.is_dated();
        let every_s = clock.every_s();
        let mut begins: Vec<f64> = Vec::new();
        for clip in &self.clips {
            let [from, to] = clip.clip.span_s.map(|t| t + clip.offset_s());
            let begin = |at: f64| if dated { clock.period_of(at) } else { (at / every_s).floor() * every_s };
            let mut at = begin(from);
            while at < to || at == begin(from) {
                begins.push(at);
                // The last period of a day may be shorter or longer, because the clocks change.
                at = begin(at + every_s).max(at + 1.0);
            }
        }
        begins.sort_by(f64::total_cmp);
        begins.dedup();
        let label = |at: f64| if dated { clock.label(at) } else { format!("{at}") };
        let period = |i: usize| {
            let from_s = begins[i];
            let to_s = begins.get(i + 1).copied().unwrap_or(f64::INFINITY).min(from_s + every_s);
            let followed_s = self.followed_s(from_s, to_s);
            Period { from_s, to_s, followed_s, labels: [label(from_s), label(to_s)] }
        };
        (0..begins.len()).map(period).collect()
    }

    /// Returns the time in which vehicles were followed between two times of the camera, s.
    pub(crate) fn followed_s(&self, from_s: f64, to_s: f64) -> f64 {
        let of_clip =
            |clip: &SiteClip| clip.clip.followed_s(from_s - clip.offset_s(), to_s - clip.offset_s());
        self.clips.iter().map(of_clip).sum()
    }

    /// Whether the tracks of every clip have sds.
    pub(crate) fn has_sds(&self) -> bool {
        self.clips.iter().all(SiteClip::has_sds)
    }

    /// Whether every clip has a date.
    pub(crate) fn is_dated(&self) -> bool {
        self.clips.iter().all(|clip| clip.clip.start_s.is_some())
    }

    /// Returns the group of a row. Without a class, the row is for all classes together.
    pub(crate) fn group(
        &self,
        place: &str,
        direction: &str,
        class: Option<VehicleClass>,
        period: &Period,
    ) -> Group {
        let [from, to] = period.labels.clone();
        Group {
            camera: self.name.clone(),
            place: place.to_owned(),
            direction: direction.to_owned(),
            class: class.map_or("all", VehicleClass::name).to_owned(),
            from,
            to,
            followed_s: period.followed_s,
        }
    }
}

/// All classes together, and each class.
pub(crate) fn classes() -> impl Iterator<Item = Option<VehicleClass>> {
    std::iter::once(None).chain(VehicleClass::ALL.map(Some))
}
