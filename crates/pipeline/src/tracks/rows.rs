//! Converts a track to rows: positions, observed or projected boxes, and whether the two agree.

use roadplane_base::{TrackRow, bbox_inside, bbox_iou};
use roadplane_measure::{FrameBoxes, FrameCamera, body_box, car_body, filled_boxes, projected_box};
use roadplane_track::{Join, Track, TrackState};

use crate::tracks::pass::Pass;
use crate::tracks::shared_error::shared_covariance;
use crate::tracks::views::Views;

/// Least overlap of an observed row's box with the vehicle's projected box (intersection over union).
const MIN_ROW_OVERLAP: f64 = 0.3;

/// Returns the probability of the join that a state belongs to: the state is within its gap, or is the first after it.
fn same_vehicle_p(track: &Track, state: &TrackState) -> Option<f64> {
    let frame = state.stamp.index;
    let is_own = |join: &&Join| join.from.index < frame && frame <= join.to.index;
    track.joins.iter().find(is_own).map(Join::same_vehicle_p)
}

impl Pass<'_> {
    /// Returns the boxes of a track's vehicle, one for each state; none without a camera. A detection counts if its box
    /// agrees with the track's position. Another box belongs to another vehicle.
    fn boxes(&self, track: &Track, views: &Views) -> Vec<FrameBoxes> {
        let boxes = |state: &TrackState| {
            let time_s = state.stamp.time_s();
            let estimate = self.cameras.at(time_s)?;
            let picture_px = views.picture_px(state.stamp.index, estimate.image_size_px);
            let view = FrameCamera::from(estimate);
            let projected_px = match track.dims_m {
                Some(dims_m) => body_box(&view, &state.pose, track.class, &dims_m),
                None => {
                    let camera_from_car = view.camera_from_car(&state.pose);
                    projected_box(self.atlas, &view.camera, &camera_from_car, &track.shape.mean)
                }
            };
            let is_own = |measured: &[f64; 4]| {
                let drawn = projected_px.map(|projected| bbox_inside(&projected, &picture_px));
                drawn.is_none_or(|drawn| bbox_iou(&drawn, measured) >= MIN_ROW_OVERLAP)
            };
            Some(FrameBoxes { time_s, picture_px, projected_px, measured_px: state.bbox_px.filter(is_own) })
        };
        track.states.iter().map_while(boxes).collect()
    }

    /// Returns whether most detections of a track agree with its positions.
    pub(crate) fn is_where_it_is_seen(&self, track: &Track, views: &Views) -> bool {
        let boxes = self.boxes(track, views);
        let cars = track.states.iter().zip(&boxes).filter(|(state, _)| state.car.is_some());
        let is_own: Vec<bool> = cars.map(|(_, boxes)| boxes.measured_px.is_some()).collect();
        2 * is_own.iter().filter(|is_own| **is_own).count() >= is_own.len()
    }

    /// Returns the rows of a track, one for each frame in which its vehicle is in the picture. Boxes are in px of their
    /// frames.
    pub(crate) fn rows(&self, track: &Track, views: &Views) -> Vec<TrackRow> {
        let dims = track.dims_m.unwrap_or_else(|| car_body(self.atlas, &track.shape.mean).dims_m);
        let boxes = self.boxes(track, views);
        let filled_px = filled_boxes(&boxes);
        let row = |(i, state): (usize, &TrackState)| {
            let estimate = self.cameras.at(state.stamp.time_s())?;
            let FrameBoxes { picture_px, measured_px, .. } = boxes[i];
            // A part of less than a pixel cannot be seen.
            let is_visible = |[x0, y0, x1, y1]: &[f64; 4]| x1 - x0 >= 1.0 && y1 - y0 >= 1.0;
            let filled_px = filled_px[i].map(|filled| bbox_inside(&filled, &picture_px)).filter(is_visible);
            let in_world = measured_px.or(filled_px)?;
            let bbox_px = views.in_picture(state.stamp.index, &in_world);
            let part = estimate.ground().part_at(state.pose.x_m, state.pose.y_m);
            let (pose, z_m) = part.in_world(&state.pose);
            // The sds of each row include the error that all cars share.
            let shared = shared_covariance(estimate, &state.pose);
            let whole = |own: f64, i: usize| (own * own + shared[(i, i)]).sqrt();
            Some(TrackRow {
                frame: state.stamp.index,
                time_s: state.stamp.time_s(),
                track: track.id,
                x_m: pose.x_m,
                y_m: pose.y_m,
                heading_rad: pose.heading_rad,
                speed_mps: state.speed_mps,
                x_sd_m: whole(state.pose_sd.x, 0),
                y_sd_m: whole(state.pose_sd.y, 1),
                heading_sd_rad: whole(state.pose_sd.z, 2),
                length_m: dims.x,
                width_m: dims.y,
                height_m: dims.z,
                bbox_px,
                score: if measured_px.is_some() { state.score } else { 0.0 },
                observed: measured_px.is_some(),
                class: track.class,
                segment: self.cameras.segment_at(state.stamp.time_s()),
                speed_sd_mps: state.speed_sd_mps.hypot(state.speed_mps * shared[(3, 3)].sqrt()),
                activity: None,
                activity_p: None,
                x_own_sd_m: Some(state.pose_sd.x),
                y_own_sd_m: Some(state.pose_sd.y),
                exists_p: Some(track.evidence.probability()),
                same_vehicle_p: same_vehicle_p(track, state),
                ground: part.index,
                z_m,
                on_map: self
                    .place
                    .and_then(|place| place.on_map(&pose, [state.pose_sd.x, state.pose_sd.y], estimate).ok()),
            })
        };
        track.states.iter().enumerate().filter_map(row).collect()
    }
}
