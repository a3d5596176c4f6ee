//! Solves the cars of a window for the camera.

use std::collections::BTreeMap;

use roadplane_base::{
    Camera, CameraParams, ImageSize, Keypoint, Lens, ParkedCar, ShapeAtlas, bbox_foot, bbox_longer_side,
};
use roadplane_calibrate::{CarIdentity, CarUse, GroundEvidence, GroundView, View, Window, WindowEstimate};
use roadplane_measure::projected_box;
use roadplane_solve::{CarView, SceneOptions, solve_scene};

use crate::Config;

/// Solves the windows of a clip, each from the result of the previous one.
pub(crate) struct Solving<'a> {
    atlas: &'a ShapeAtlas,
    config: &'a Config,
    /// Camera of the last solved window by position. The next solve starts there.
    starts: BTreeMap<usize, CameraParams>,
    /// Estimates of the solved windows, in order.
    pub windows: Vec<WindowEstimate>,
    /// Parked vehicles of all solved windows.
    pub parked: BTreeMap<CarIdentity, ParkedCar>,
    /// Evidence of all solved windows on the shape of the ground.
    pub ground: GroundEvidence,
}

impl<'a> Solving<'a> {
    /// Creates a solver without windows.
    pub fn new(atlas: &'a ShapeAtlas, config: &'a Config) -> Self {
        let (starts, windows, parked, ground) = Default::default();
        Self { atlas, config, starts, windows, parked, ground }
    }

    /// Solves a window and stores its results. A window without a usable solution is dropped.
    pub fn solve(&mut self, window: &Window, size: ImageSize, lens: Lens, focal_px: Option<f64>) {
        let (atlas, config) = (self.atlas, self.config);
        let start = self.starts.range(..=window.position).next_back().map(|(_, camera)| *camera);
        let options = SceneOptions { start, lens, ..config.solve.scene_options(focal_px) };
        let mut links: Vec<_> = window.views.iter().map(|view| view.link).collect();
        links.sort_unstable();
        links.dedup();
        let solved = |views: &[&View], options: &SceneOptions| {
            let cars: Vec<CarView<'_>> = views
                .iter()
                .map(|view| CarView {
                    keypoints: &view.keypoints,
                    group: links.binary_search(&view.link).unwrap_or(0),
                    weight: view.weight,
                })
                .collect();
            solve_scene(atlas, size, &cars, options)
        };
        let mut views: Vec<&View> = window.views.iter().collect();
        let mut solution = solved(&views, &options);
        // A box without a car is recognised only when the plane is determined. Such boxes are removed, and the window
        // is solved again.
        let camera = Camera { lens: options.lens, ..Camera::centred(solution.params.focal_px(), size) };
        let limits = config.solve.fit_limits();
        let is_trusted: Vec<bool> = views
            .iter()
            .zip(&solution.cars)
            .map(|(view, car)| {
                car.as_ref().is_some_and(|car| {
                    let projected = projected_box(atlas, &camera, &car.camera_from_car, &car.shape);
                    limits.is_valid(projected, &view.bbox_px, car.reprojection_rms_px, &view.picture_px)
                })
            })
            .collect();
        if solution.status.usable() && is_trusted.contains(&false) && is_trusted.contains(&true) {
            let kept = views.into_iter().zip(&is_trusted).filter(|(_, trusted)| **trusted);
            views = kept.map(|(view, _)| view).collect();
            solution = solved(&views, &SceneOptions { start: Some(solution.params), ..options.clone() });
        }
        tracing::debug!(
            status = ?solution.status, views = views.len(), cars = links.len(),
            focal_px = solution.params.focal_px(), tilt_deg = solution.params.tilt.to_degrees(),
            height_m = solution.params.log_height.exp(), "window solved"
        );
        if !solution.status.usable() {
            return;
        }
        let on_ground = views.iter().zip(&solution.cars).zip(&solution.plane_evidence);
        self.ground.add(
            solution.params,
            on_ground.filter_map(|((view, car), evidence)| {
                let evidence = evidence.as_ref().filter(|_| car.as_ref().is_some_and(|car| car.used))?;
                let foot_px = options.lens.undistorted(&(bbox_foot(&view.bbox_px) - size.centre_px()));
                Some(GroundView {
                    link: view.link,
                    parked: view.parked,
                    foot_px,
                    information: evidence.information,
                    gradient: evidence.gradient,
                    side_px: bbox_longer_side(&view.bbox_px),
                })
            }),
        );
        let used = views.iter().zip(&solution.cars).filter(|(_, car)| car.as_ref().is_some_and(|c| c.used));
        let used: Vec<&View> = used.map(|(view, _)| *view).collect();
        let mut cars: Vec<CarUse> = used
            .iter()
            .map(|view| CarUse { car: CarIdentity::Clip(view.link), parked: view.parked })
            .collect();
        // A car with stationary and moving views counts as parked, which claims less.
        cars.sort_by_key(|used| (used.car, !used.parked));
        cars.dedup_by_key(|used| used.car);
        let (params, joint) = solution.by_cars();
        self.starts.insert(window.position, params);
        self.windows.push(WindowEstimate {
            span_s: window.span_s,
            frames: window.frames,
            params,
            joint,
            cars,
            position: window.position,
        });
        let parked = used.iter().filter(|view| view.parked);
        self.parked.extend(parked.map(|view| (CarIdentity::Clip(view.link), parked_car(view))));
    }
}

/// Returns a view as a parked car for the database, rounded to a tenth of a pixel.
fn parked_car(view: &View) -> ParkedCar {
    let rounded = |v: f64| (v * 10.0).round() / 10.0;
    let pixel = |point: &Keypoint| [rounded(point.pixel.x), rounded(point.pixel.y)];
    ParkedCar {
        bbox_px: view.bbox_px.map(rounded),
        keypoints_px: view.keypoints.iter().map(|point| point.as_ref().map(pixel)).collect(),
    }
}
