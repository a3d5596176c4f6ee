//! How large a truck or bus is: by all boxes of its track, once that says how it is turned.

use nalgebra::{Matrix3, Vector2, Vector3};
use roadplane_track::{Track, TrackState};

use crate::cameras::camera_track::CameraTrack;
use crate::tracks::cars::FrameCamera;
use crate::tracks::ground_contact::{Body, body_of, size_seen};

/// Looks from one place share their errors and count as one: until it moved so far, m.
const VIEW_M: f64 = 2.0;

/// Correlation of what views get wrong: the camera, and what bodies look like. So many views, weighted by what they tell, count as
/// fewer (design effect and effective number: Kish 1965, "Survey Sampling").
const SHARED: f64 = 0.5;

/// The class' sizes, counted once, and what the boxes say, view by view; boxes of which nothing is hidden, where there are any.
pub(crate) fn body_of_track(track: &Track, cameras: &CameraTrack) -> Body {
    let prior = body_of(track.class);
    let mut precision = Matrix3::from_diagonal(&prior.sd_m.map(|sd| sd.powi(-2)));
    let mut weighted = precision * prior.dims_m;
    let looks = || track.states.iter().filter(|state| state.car.is_some() && !state.held);
    let any_whole = looks().any(|state| !state.hidden);
    let mut views: Vec<View> = Vec::new();
    for state in looks().filter(|state| !(any_whole && state.hidden)) {
        let Some((information, sizes)) = size_in(state, &prior, cameras) else { continue };
        let at = Vector2::new(state.pose.x_m, state.pose.y_m);
        if views.last().is_none_or(|view| (view.at - at).norm() > VIEW_M) {
            views.push(View { at, ..View::default() });
        }
        if let Some(view) = views.last_mut() {
            view.information += information;
            view.weighted += sizes;
            view.looks += 1.0;
        }
    }
    let all: f64 = views.iter().map(View::about_length).sum();
    let squares: f64 = views.iter().map(|view| view.about_length().powi(2)).sum();
    let share = 1.0 / (1.0 + SHARED * (all * all / squares.max(f64::MIN_POSITIVE) - 1.0).max(0.0));
    for view in &views {
        precision += view.information * (share / view.looks);
        weighted += view.weighted * (share / view.looks);
    }
    match precision.try_inverse() {
        Some(covariance) => Body {
            class: track.class,
            dims_m: covariance * weighted,
            sd_m: covariance.diagonal().map(|variance| variance.max(0.0).sqrt()),
        },
        None => prior,
    }
}

/// Looks from about one place, summed.
#[derive(Default)]
struct View {
    at: Vector2<f64>,
    information: Matrix3<f64>,
    weighted: Vector3<f64>,
    looks: f64,
}

impl View {
    fn about_length(&self) -> f64 {
        self.information[(0, 0)] / self.looks.max(1.0)
    }
}

fn size_in(state: &TrackState, body: &Body, cameras: &CameraTrack) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    let estimate = cameras.at(state.stamp.time_s())?;
    let heading = [state.pose.heading_rad, state.pose_sd.z];
    size_seen(&state.bbox_px?, estimate.image_size_px, &FrameCamera::from(estimate), body, heading)
}
