//! Learns in which rows of the picture vehicles are small. There, the fine pass pays.
//!
//! On a road, vehicles get smaller towards the horizon. So the rows above a certain one show small vehicles, and the
//! others large ones.

use roadplane_base::CarRecord;

/// Longer side of the box below which a vehicle is small, px of the net's input in the finest other pass. The fine pass
/// finds more of such vehicles (`models/detector.md`).
const SMALL_PX: f64 = 40.0;
/// Number of bands into which the picture is divided.
const BANDS: usize = 24;

/// The numbers of small and large vehicles that were detected in each band of the picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct FineRows {
    /// Number of small vehicles less the number of large ones, by the band of the box's lower edge; from above.
    small: [i64; BANDS],
}

impl FineRows {
    /// Adds the vehicles of a frame, for a picture of this height, px. `scale` is that of the finest other pass.
    pub(crate) fn add(&mut self, cars: &[CarRecord], height: f64, scale: f64) {
        for car in cars {
            let [x0, y0, x1, y1] = car.bbox_px;
            let band = (y1 / height * BANDS as f64).clamp(0.0, BANDS as f64 - 1.0) as usize;
            self.small[band] += if (x1 - x0).max(y1 - y0) * scale < SMALL_PX { 1 } else { -1 };
        }
    }

    /// Returns the row that best separates small vehicles above it from large ones below, px. It is 0 if no vehicles are
    /// small.
    pub(crate) fn end_px(&self, height: f64) -> f64 {
        let (mut sum, mut most, mut end) = (0, 0, 0);
        for (band, small) in self.small.iter().enumerate() {
            sum += small;
            if sum > most {
                (most, end) = (sum, band + 1);
            }
        }
        end as f64 / BANDS as f64 * height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_vehicles_are_above_the_row() {
        let car = |y1: f64, side: f64| CarRecord::boxed([100.0, y1 - side / 2.0, 100.0 + side, y1]);
        let mut rows = FineRows::default();
        assert_eq!(rows.end_px(720.0), 0.0, "no vehicle");
        rows.add(&[car(400.0, 100.0), car(600.0, 200.0), car(500.0, 30.0)], 720.0, 1.0);
        assert_eq!(rows.end_px(720.0), 0.0, "a small one among large ones");
        rows.add(&[car(200.0, 35.0), car(205.0, 30.0), car(150.0, 20.0)], 720.0, 1.0);
        assert_eq!(rows.end_px(720.0), 210.0);
        rows.add(&[car(200.0, 35.0)], 720.0, 2.0);
        assert_eq!(rows.end_px(720.0), 210.0, "the net sees it larger");
    }
}
