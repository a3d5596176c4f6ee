//! Scores the registrations of rendered pictures against truth.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector2;
use roadplane_base::{Homography, ImageSize};
use roadplane_metrics::truth::Truth;
use roadplane_tables::{Cell, Column, Table, quantile};
use roadplane_write::FrameReader;

use crate::LabError;

/// Upper ends of the groups of claimed sds, px; the last group is open.
const SDS_PX: [f64; 4] = [0.15, 0.25, 0.4, f64::INFINITY];
/// Error from which a registration counts as wrong, px. Boxes have such errors.
const WRONG_PX: f64 = 1.0;
/// Points of a picture that are compared, in each direction.
const POINTS: u32 = 5;

/// Claimed sd and true error of registrations, px.
#[derive(Clone, Debug, Default)]
pub(super) struct Registrations(Vec<[f64; 2]>);

impl Registrations {
    /// Adds the registrations of displaced pictures of a run. Each picture counts once, by its most accurate registration.
    pub fn add(&mut self, frames: &Path, truth: &Truth) -> Result<(), LabError> {
        let exact = |frame: &roadplane_metrics::truth::TrueFrame| {
            Some((frame.frame, Homography::from_numbers(frame.picture_from_world?)?))
        };
        let exact: BTreeMap<u64, Homography> = truth.frames.iter().filter_map(exact).collect();
        for frame in FrameReader::open(frames)? {
            let frame = frame?;
            let first = frame.watch.as_ref().and_then(|watch| watch.motion.first());
            let Some(found) = first.filter(|first| first.homography.is_some()) else { continue };
            if let (Some(reference), Some(here)) = (exact.get(&found.reference), exact.get(&frame.frame)) {
                let exact = reference.inverse().then(here);
                let error = error_px(&exact, &found.homography_for(0.0), frame.image_size_px);
                self.0.push([found.sd_px, error]);
            }
        }
        Ok(())
    }

    /// Returns the errors by claimed sd.
    pub fn table(&self) -> Table {
        let columns = [
            ("claimed sd below, px", 2),
            ("pictures", 0),
            ("error, median, px", 3),
            ("error / sd, median", 2),
            ("error above 1 px, %", 1),
        ];
        let note = "Error: rms distance between the registered and the true position of points of the reference in \
                    view. An error of the sd has a median of about 0.9 sds.";
        let mut table = Table::new(
            "Registrations of pictures",
            note,
            columns.iter().map(|(title, decimals)| Column::new(*title, *decimals)).collect(),
        );
        let mut from = 0.0;
        for to in SDS_PX {
            let here: Vec<[f64; 2]> =
                self.0.iter().copied().filter(|[sd, _]| (from..to).contains(sd)).collect();
            let errors: Vec<f64> = here.iter().map(|[_, error]| *error).collect();
            let ratios: Vec<f64> = here.iter().map(|[sd, error]| error / sd).collect();
            let wrong = errors.iter().filter(|error| **error > WRONG_PX).count();
            let numbers = [
                to,
                here.len() as f64,
                quantile(&errors, 0.5),
                quantile(&ratios, 0.5),
                100.0 * wrong as f64 / here.len() as f64,
            ];
            table.rows.push(numbers.map(Cell::from).into());
            from = to;
        }
        table
    }
}

/// Returns the rms distance between two mappings over the part of the reference in view, px.
fn error_px(exact: &Homography, found: &Homography, size: ImageSize) -> f64 {
    let at = |i: u32, side: u32| f64::from(i) / f64::from(POINTS - 1) * (f64::from(side) - 1.0);
    let points =
        (0..POINTS * POINTS).map(|i| Vector2::new(at(i % POINTS, size.width), at(i / POINTS, size.height)));
    let [x0, y0, x1, y1] = size.picture_px();
    let squares: Vec<f64> = points
        .filter(|point| {
            let q = exact.apply(point);
            (x0..x1).contains(&q.x) && (y0..y1).contains(&q.y)
        })
        .map(|point| (exact.apply(&point) - found.apply(&point)).norm_squared())
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_that_of_the_part_in_view() {
        let size = ImageSize { width: 640, height: 360 };
        let shift = |x: f64| Homography::from_numbers([1.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0]).unwrap();
        assert!((error_px(&shift(100.0), &shift(101.5), size) - 1.5).abs() < 1e-9);
        assert!(error_px(&shift(700.0), &shift(701.5), size).is_nan());
        let sixth = Registrations(vec![[0.1, 0.05], [0.2, 0.3], [0.2, 2.0]]);
        let rows = sixth.table().rows;
        assert_eq!(rows.len(), SDS_PX.len());
    }
}
