//! Gates and zones with the volumes of traffic, drawn from above or on a picture.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use image::RgbImage;
use nalgebra::{Point3, Vector2};
use roadplane_base::{CameraEstimate, PictureMotion};
use roadplane_traffic::{Site, TrafficFile, TrafficPlace};

use crate::ViewError;
use crate::report::{data_uri, escape};

/// Width of a drawing whose lines have the widths of this file, px.
const USUAL_PX: f64 = 1080.0;
/// Width of the arrow of the largest flow, px.
const WIDEST_PX: f64 = 18.0;
/// Length of an arrow before and behind its gate, and distance of its number, px.
const ARROW_PX: [f64; 3] = [11.0, 28.0, 48.0];
/// Number of parts into which an edge is divided, as a straight line on the ground may be curved in a picture.
const PARTS: u32 = 16;

/// Colour and size of texts and lines.
pub(super) struct Ink<'a> {
    /// Attributes of a number.
    pub(super) text: &'a str,
    /// Factor on all widths and lengths.
    pub(super) scale: f64,
}

/// A picture of the road, to draw on.
#[derive(Clone, Copy, Debug)]
pub struct RoadPicture<'a> {
    /// The picture in full size.
    pub picture: &'a RgbImage,
    /// Camera of the picture.
    pub camera: &'a CameraEstimate,
    /// Mapping from pixels of the camera to pixels of the picture; `None` if the picture is not displaced.
    pub picture_from_world: Option<&'a PictureMotion>,
}

impl RoadPicture<'_> {
    /// Returns the pixel of a ground position (m); `None` if it is not in the picture.
    fn pixel_of(&self, [x_m, y_m]: [f64; 2]) -> Option<[f64; 2]> {
        let point = self.camera.params.plane().camera_from_world()
            * Point3::new(x_m, y_m, self.camera.ground().height_at(x_m, y_m));
        let pixel = self.camera.camera().pixel_from_camera(&point.coords)?;
        let pixel = self.picture_from_world.map_or(pixel, |view| view.apply(&pixel));
        let (width, height) = self.picture.dimensions();
        let is_inside =
            (0.0..f64::from(width)).contains(&pixel.x) && (0.0..f64::from(height)).contains(&pixel.y);
        is_inside.then(|| pixel.into())
    }
}

/// Returns the picture of the road with gates, zones and volumes; `None` for an unknown camera.
///
/// # Errors
/// [`ViewError`] if the picture cannot be written.
pub(super) fn on_picture(
    site: &Site,
    file: &TrafficFile,
    road: &RoadPicture<'_>,
) -> Result<Option<String>, ViewError> {
    let (width, height) = road.picture.dimensions();
    let scale = f64::from(width) / USUAL_PX;
    let text = "fill=\"#fff\" stroke=\"#000\" stroke-width=\".2em\" paint-order=\"stroke\"";
    let Some(places) = places_with_volumes(site, file, &|at| road.pixel_of(at), &Ink { text, scale }) else {
        return Ok(None);
    };
    Ok(Some(format!(
        "<svg viewBox=\"0 0 {width} {height}\" width=\"{width}\" role=\"img\" aria-label=\"gates and volumes on the \
         picture\" font-size=\"{:.0}\"><image href=\"{}\" width=\"{width}\" height=\"{height}\"/>{places}</svg>\n",
        16.0 * scale,
        data_uri(road.picture)?
    )))
}

/// Returns the gates and zones of a camera with their volumes, as parts of an SVG. `at` returns the place of a ground
/// position (m) in the drawing, px.
pub(super) fn places_with_volumes(
    site: &Site,
    file: &TrafficFile,
    at: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
    ink: &Ink<'_>,
) -> Option<String> {
    let camera = file.cameras.iter().find(|camera| camera.name == site.name)?;
    let volumes = volumes(site, file);
    let most = volumes.values().copied().max().unwrap_or(0).max(1) as f64;
    let mut svg = String::new();
    let mut put = |text: std::fmt::Arguments<'_>| {
        let _infallible = svg.write_fmt(text);
    };
    for place in &camera.places {
        let outline = outline(place, at);
        let Some([x, y]) = outline.first() else { continue };
        let mut points = String::new();
        for [x, y] in &outline {
            let _infallible = write!(points, "{x:.1},{y:.1} ");
        }
        let (shape, colour) = if place.is_zone { ("polygon", "#2f9e62") } else { ("polyline", "#d9480f") };
        put(format_args!(
            "<{shape} points=\"{points}\" fill=\"{}\" fill-opacity=\".15\" stroke=\"{colour}\" stroke-width=\"{:.1}\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" fill=\"{colour}\">{}</text>",
            if place.is_zone { colour } else { "none" },
            2.5 * ink.scale,
            y - 6.0 * ink.scale,
            escape(&place.name)
        ));
        if place.is_zone {
            continue;
        }
        for (direction, sign) in [("forward", 1.0), ("backward", -1.0)] {
            let volume = volumes.get(&(place.name.as_str(), direction)).copied().unwrap_or(0);
            let Some([from, to, text]) = arrow(&place.points_m, sign, at, ink.scale).filter(|_| volume > 0)
            else {
                continue;
            };
            let width = (volume as f64 / most * WIDEST_PX).max(2.0) * ink.scale;
            put(format_args!(
                "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"#d9480f\" stroke-opacity=\".6\" stroke-width=\"{width:.1}\"/>\
                 <circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{:.1}\" fill=\"#d9480f\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" {} font-weight=\"600\" text-anchor=\"middle\">{volume}</text>",
                from.x,
                from.y,
                to.x,
                to.y,
                to.x,
                to.y,
                width / 2.0 + 3.0 * ink.scale,
                text.x,
                text.y,
                ink.text
            ));
        }
    }
    Some(svg)
}

/// Returns the line of a gate or the outline of a zone in the drawing, px. Parts that are not in it are left out.
fn outline(place: &TrafficPlace, at: &dyn Fn([f64; 2]) -> Option<[f64; 2]>) -> Vec<[f64; 2]> {
    let mut points = place.points_m.iter().copied().map(Vector2::from);
    let next = points.clone().skip(1).chain(points.clone().next().filter(|_| place.is_zone));
    let parts = points
        .clone()
        .zip(next)
        .flat_map(|(a, b)| (0..PARTS).map(move |part| a + (b - a) * (f64::from(part) / f64::from(PARTS))));
    parts.chain(points.next_back().filter(|_| !place.is_zone)).filter_map(|point| at(point.into())).collect()
}

/// Returns begin and end of a gate's arrow and the place of its number, px. The arrow points to the side to which the
/// vehicles drive; `sign` is 1 for forward, which is to the right of the line.
fn arrow(
    line: &[[f64; 2]],
    sign: f64,
    at: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
    scale: f64,
) -> Option<[Vector2<f64>; 3]> {
    let [a, b] = [line.first()?, line.last()?].map(|point| Vector2::from(*point));
    let along = (b - a).try_normalize(0.0)?;
    let right = Vector2::new(along.y, -along.x) * sign;
    // The arrows of the two directions lie side by side.
    let middle = a + (b - a) * if sign > 0.0 { 0.35 } else { 0.65 };
    let place = |p: Vector2<f64>| at(p.into()).map(Vector2::from);
    let (from, to) = (place(middle)?, place(middle + right)?);
    let direction = (to - from).try_normalize(0.0)?;
    let [behind, before, number] = ARROW_PX.map(|px| px * scale);
    Some([from - direction * behind, from + direction * before, from + direction * number])
}

/// Number of vehicles over all periods, by gate and direction.
fn volumes<'a>(site: &Site, file: &'a TrafficFile) -> BTreeMap<(&'a str, &'a str), u64> {
    let mut volumes = BTreeMap::new();
    let of_all =
        |row: &&roadplane_traffic::CountRow| row.group.camera == site.name && row.group.class == "all";
    for row in file.figures.counts.iter().filter(of_all) {
        *volumes.entry((row.group.place.as_str(), row.group.direction.as_str())).or_default() +=
            row.vehicles.unwrap_or(0);
    }
    volumes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture in which one metre is 10 px, and which shows x from 0 to 50 m.
    fn at([x, y]: [f64; 2]) -> Option<[f64; 2]> {
        (0.0..50.0).contains(&x).then_some([10.0 * x, 500.0 - 10.0 * y])
    }

    #[test]
    fn an_arrow_points_to_the_side_to_which_vehicles_drive() {
        // A line to the north: forward is to the east, which is to the right in the picture.
        let line = [[10.0, 0.0], [10.0, 10.0]];
        for (sign, y) in [(1.0, 465.0), (-1.0, 435.0)] {
            let [from, to, number] = arrow(&line, sign, &at, 1.0).unwrap();
            assert_eq!((from.y, to.y), (y, y));
            assert_eq!([from.x, to.x, number.x], [11.0, -28.0, -48.0].map(|px| 100.0 - sign * px));
        }
        assert!(arrow(&[[60.0, 0.0], [60.0, 10.0]], 1.0, &at, 1.0).is_none(), "not in the picture");
    }

    #[test]
    fn parts_of_a_gate_outside_the_picture_are_left_out() {
        let points_m = vec![[40.0, 0.0], [60.0, 0.0]];
        let place = TrafficPlace { points_m, ..TrafficPlace::default() };
        let drawn = outline(&place, &at);
        assert_eq!(drawn.len(), 8);
        assert!(drawn.iter().all(|[x, y]| *x < 500.0 && *y == 500.0), "{drawn:?}");
    }
}
