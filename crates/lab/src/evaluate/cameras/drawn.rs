//! Draws the pictures of the cameras with the largest errors: estimated horizon, ground grid and cars, and the true
//! horizon.

use image::RgbImage;
use roadplane_base::{Shape, ShapeAtlas};
use roadplane_pipeline::{Config, PipelineError, open_input};
use roadplane_tables::Picture;
use roadplane_view::{GroundCells, Overlay, Rgb, horizon_y_px};

use super::measured::Measured;
use crate::LabError;
use roadplane_metrics::truth::isometry_from_rows;

/// Number of cameras that are drawn.
const WORST: usize = 6;
/// Greatest width of a drawn picture, px.
const WIDTH: u32 = 1280;
/// Number of rows of pixels between the top of the drawing and the higher of the two horizons.
const MARGIN_PX: f64 = 20.0;
/// Greatest number of rows that are added above the picture to show a horizon, as a share of the picture's height.
const MOST_LIFT: f64 = 0.6;
/// Colour of the true horizon.
const TRUE: Rgb = [60, 220, 90];
/// Colour of the estimated horizon.
const OURS: Rgb = [255, 150, 40];
/// Colour of the cars.
const CAR: Rgb = [64, 196, 255];

/// Draws the cameras with the largest errors, the largest first.
///
/// Cameras are ordered by the sum of squares of their errors divided by the errors' sds.
pub(super) fn worst(
    measured: &[Measured],
    atlas: &ShapeAtlas,
    config: &Config,
) -> Result<Vec<Picture>, LabError> {
    let mut order: Vec<&Measured> = measured.iter().collect();
    let badness = |m: &Measured| m.outcome.in_sds.norm_squared();
    order.sort_by(|a, b| badness(b).total_cmp(&badness(a)));
    order.into_iter().take(WORST).map(|m| drawn(m, atlas, config)).collect()
}

fn drawn(measured: &Measured, atlas: &ShapeAtlas, config: &Config) -> Result<Picture, LabError> {
    let Measured { camera: reference, outcome, .. } = measured;
    let estimate = &outcome.estimate;
    let (mut ours, mut truth) = (estimate.camera(), reference.camera());
    let plane = estimate.params.plane();
    let mut input = open_input(&reference.media, config)?;
    let frame = input.next_frame().map_err(PipelineError::from)?;
    let size = [estimate.image_size_px.width, estimate.image_size_px.height];
    let picture = frame.map_or_else(|| RgbImage::new(size[0], size[1]), |frame| frame.image);
    // Adds rows above the picture if a horizon lies above the picture.
    let highest = [(&ours, &plane), (&truth, &reference.plane)]
        .into_iter()
        .flat_map(|(camera, plane)| [0, size[0]].map(|x| horizon_y_px(camera, plane, f64::from(x))))
        .flatten()
        .fold(f64::INFINITY, f64::min);
    let lift = (MARGIN_PX - highest).clamp(0.0, f64::from(size[1]) * MOST_LIFT) as u32;
    let mut lifted = RgbImage::from_pixel(picture.width(), picture.height() + lift, image::Rgb([60; 3]));
    image::imageops::replace(&mut lifted, &picture, 0, i64::from(lift));
    for camera in [&mut ours, &mut truth] {
        camera.principal_point_px.y += f64::from(lift);
    }
    let fail = |error| LabError::from(PipelineError::View(error));
    let mut overlay = Overlay::new(&lifted, &ours, estimate.ground(), atlas).map_err(fail)?;
    let mut cells = GroundCells::default();
    for car in &outcome.cars {
        cells.add(car.world_from_car[0][3], car.world_from_car[1][3]);
    }
    overlay.grid(&cells).map_err(fail)?;
    for car in outcome.cars.iter().filter(|car| car.used) {
        overlay
            .posed(&isometry_from_rows(&car.camera_from_car), &Shape::from(car.shape), CAR)
            .map_err(fail)?;
    }
    overlay.horizon(&truth, &reference.plane, TRUE).map_err(fail)?;
    overlay.horizon(&ours, &plane, OURS).map_err(fail)?;
    let mut picture = overlay.finish().map_err(fail)?;
    if picture.width() > WIDTH {
        let height = (picture.height() * WIDTH / picture.width()).max(1);
        picture = image::imageops::resize(&picture, WIDTH, height, image::imageops::FilterType::Triangle);
    }
    Ok(Picture::new(caption(measured), &picture)?)
}

fn caption(measured: &Measured) -> String {
    let Measured { camera: reference, outcome, .. } = measured;
    let params = &outcome.estimate.params;
    format!(
        "{}: focal length {:.0} px, truth {:.0} ({:+.1} sd); tilt {:.1}°, truth {:.1}° ({:+.1} sd); horizon {:+.0} px off \
         (orange ours, green true); the ground every 5 m, and the cars, by our camera",
        reference.id,
        params.focal_px(),
        reference.focal_px,
        outcome.in_sds[0],
        params.tilt.to_degrees(),
        reference.plane.tilt().to_degrees(),
        outcome.in_sds[1],
        outcome.horizon_px,
    )
}
