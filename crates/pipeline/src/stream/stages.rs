//! The stages that look at pictures: watch → detect → keypoints.

use roadplane_base::PictureVerdict;
use roadplane_detect::{Detector, RoiScheduler};
use roadplane_keypoints::{KeypointNet, Schedule};
use roadplane_watch::{Background, Watcher};

use crate::stream::cadence::{Cadence, stretch_of};
use crate::stream::flow::{Stage, Work};
use crate::stream::scene_lines::LineFinder;

/// The stage that watches the picture.
pub fn watch_stage<'a>() -> Stage<'a> {
    let mut watcher = Watcher::new();
    Stage::new("watch", move |work: &mut Work| {
        work.record.watch = Some(match &work.image {
            Some(image) => {
                let seen = work.seen.insert(watcher.look(work.stamp, image)?);
                seen.record.clone()
            }
            None => watcher.unlooked(),
        });
        Ok(())
    })
}

/// The stage that finds vehicles, and learns how the place looks without them, and its lines.
pub(crate) fn detect_stage<'a>(
    detector: &'a mut Detector,
    cadence: Cadence,
    background: &'a mut Option<Background>,
    mut lines: LineFinder,
) -> Stage<'a> {
    let mut memory: Option<(u64, RoiScheduler)> = None;
    Stage::new("detect", move |work: &mut Work| {
        let stretch = stretch_of(work.record.time_s);
        let (_, attention) = match &mut memory {
            Some(memory) if memory.0 == stretch && cadence.attention => memory,
            memory => memory.insert((stretch, RoiScheduler::new(cadence.looks_a_sweep))),
        };
        let (Some(image), Some(seen)) = (&work.image, &work.seen) else {
            work.record.cars = attention.held();
            return Ok(());
        };
        let look = attention.look(detector, work.stamp, cadence.number(work.stamp.index), image, seen)?;
        if let Some(watch) = &mut work.record.watch {
            let rounded = |share: f64| Some((share * 1e4).round() / 1e4);
            (watch.changed, watch.seen) = (rounded(look.changed), rounded(look.seen));
        }
        if seen.is_new_position {
            *background = None;
        }
        let background = background.get_or_insert_with(|| Background::new(image, look.busy.emptied()));
        if seen.record.verdict == PictureVerdict::Rest {
            background.take(image, &look.busy, work.record.time_s);
        }
        let told = lines.look(seen, background.picture(), &look.cars, work.record.time_s)?;
        (work.record.scene_lines, work.record.scene_curves) = told.unzip();
        (work.record.cars, work.record.weak) = (look.cars, look.weak);
        Ok(())
    })
}

/// The stage that finds keypoints; every car of every frame without attention.
pub fn keypoint_stage(net: &mut KeypointNet, cadence: Cadence) -> Stage<'_> {
    let schedule = move || Schedule::new(cadence.crops_every);
    let mut memory = (0, schedule());
    Stage::new("keypoints", move |work: &mut Work| {
        let stretch = stretch_of(work.record.time_s);
        if memory.0 != stretch || !cadence.attention {
            memory = (stretch, schedule());
        }
        Ok(net.follow(&mut memory.1, work.image.as_ref(), &mut work.record)?)
    })
}
