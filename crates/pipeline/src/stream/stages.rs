//! The stages that process pictures: first watch, then detect, then keypoints.

use roadplane_base::PictureVerdict;
use roadplane_detect::{Detector, RoiScheduler, measure_colours};
use roadplane_keypoints::{KeypointNet, Schedule};
use roadplane_watch::Watcher;

use crate::stream::backgrounds::Backgrounds;
use crate::stream::cadence::{Cadence, interval_of};
use crate::stream::flow::{Stage, Work};
use crate::stream::scene_lines::LineFinder;

/// Creates the stage that measures camera motion and changes of the picture.
pub fn watch_stage<'a>() -> Stage<'a> {
    let mut watcher = Watcher::new();
    Stage::new("watch", move |work: &mut Work| {
        work.record.watch = Some(match &work.image {
            Some(image) => {
                let seen = work.seen.insert(watcher.observe(work.stamp, image)?);
                seen.record.clone()
            }
            None => watcher.unobserved(),
        });
        Ok(())
    })
}

/// Creates the stage that detects vehicles, updates the background image and finds lines of the scene in that image.
pub(crate) fn detect_stage<'a>(
    detector: &'a mut Detector,
    cadence: Cadence,
    backgrounds: &'a mut Backgrounds,
    mut lines: LineFinder,
) -> Stage<'a> {
    let mut memory: Option<(u64, RoiScheduler)> = None;
    Stage::new("detect", move |work: &mut Work| {
        let interval = interval_of(work.record.time_s);
        let (_, regions) = match &mut memory {
            Some(memory) if memory.0 == interval && cadence.uses_regions => memory,
            memory => {
                memory.insert((interval, RoiScheduler::new(cadence.frames_per_scan, cadence.frames_per_fine)))
            }
        };
        let (Some(image), Some(seen)) = (&work.image, &work.seen) else {
            work.record.cars = regions.carried_over();
            return Ok(());
        };
        let found = regions.detect(detector, work.stamp, cadence.number(work.stamp.index), image, seen)?;
        if let Some(watch) = &mut work.record.watch {
            let rounded = |share: f64| Some((share * 1e4).round() / 1e4);
            (watch.changed, watch.seen) = (rounded(found.changed), rounded(found.inspected));
        }
        let is_empty = seen.record.verdict.is_blind() || seen.record.verdict == PictureVerdict::Frozen;
        if let Some(view) = seen.view.as_ref().filter(|_| !is_empty) {
            let (busy, time_s) = (&found.busy, work.record.time_s);
            let background = backgrounds.take(image, view, busy, seen.is_new_position, time_s);
            let edges = lines.find(seen, view, background.picture(), &found.cars, time_s)?;
            (work.record.scene_lines, work.record.scene_curves) = edges.unzip();
        }
        (work.record.cars, work.record.weak) = (found.cars, found.weak);
        Ok(())
    })
}

/// Creates the stage that measures the colours of boxes and finds the keypoints of cars. Without region-of-interest
/// scheduling, the net runs on every car of every inference frame.
pub fn keypoint_stage(net: &mut KeypointNet, cadence: Cadence) -> Stage<'_> {
    let schedule = move || Schedule::new(cadence.crops_every);
    let mut memory = (0, schedule());
    Stage::new("keypoints", move |work: &mut Work| {
        let interval = interval_of(work.record.time_s);
        if memory.0 != interval || !cadence.uses_regions {
            memory = (interval, schedule());
        }
        if let Some(image) = &work.image {
            measure_colours(image, &mut work.record);
        }
        Ok(net.follow(&mut memory.1, work.image.as_ref(), &mut work.record)?)
    })
}
