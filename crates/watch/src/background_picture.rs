//! A reduced picture of the background. Two such pictures show whether the camera was moved between two clips.

use image::{GrayImage, RgbImage};
use nalgebra::Vector2;

use crate::alignment::Alignment;
use crate::reference::{Prepared, Reference};
use crate::search::{refined, search};
use crate::{SmallGrey, WatchError};

/// Largest length of the picture's longer side, px. A turn of the camera by 2° shifts such a picture by about ten
/// pixels.
const LONGEST: usize = 240;
/// Smallest share of the blocks that must agree with an alignment. A smaller share may come from a clock drawn on the
/// picture, which does not move when the camera turns.
const MIN_SHARE: f64 = 0.25;
/// Largest difference between the measured shift of a block and the shift that the alignment predicts there, px. A
/// block with a larger difference does not agree with the alignment.
const NEAR: f64 = 0.7;

/// The displacement between two backgrounds (root mean square over the picture), and its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// Displacement, as a share of the picture's width.
    pub share: f64,
    /// Error of the displacement, as a share of the picture's width. It is the residual after an alignment to the other
    /// picture and back. Different light or vehicles seldom cause the same error in both directions. The error is
    /// infinite if the alignment succeeds in one direction only.
    pub error: f64,
}

/// A reduced grey picture of the background.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackgroundPicture(SmallGrey);

impl BackgroundPicture {
    /// Creates the reduced picture from a background at full size.
    ///
    /// # Errors
    /// [`WatchError`] when OpenCV fails.
    pub fn of(background: &RgbImage) -> Result<Self, WatchError> {
        let small = SmallGrey::of(background)?;
        Ok(Self(if small.width.max(small.height) > LONGEST { small.halved() } else { small }))
    }

    /// Restores a picture that was stored by [`Self::to_grey`].
    #[must_use]
    pub fn from_grey(image: &GrayImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        Self(SmallGrey { width, height, factor: 1, values: image.as_raw().clone() })
    }

    /// Returns the picture as a grey image, for storage.
    #[must_use]
    pub fn to_grey(&self) -> GrayImage {
        let Self(small) = self;
        GrayImage::from_fn(small.width as u32, small.height as u32, |x, y| {
            image::Luma([small.row(y as usize)[x as usize]])
        })
    }

    /// Measures the displacement of the scene between this picture and another. Returns `None` if the two cannot be
    /// aligned, because their light, scene or size differs.
    #[must_use]
    pub fn displacement(&self, other: &Self) -> Option<Displacement> {
        if !self.0.same_size(&other.0) || self.0.width < 32 || self.0.height < 32 {
            return None;
        }
        let (here, there) = (Prepared::of(&self.0), Prepared::of(&other.0));
        let size =
            |alignment: &Alignment| alignment.displacement(self.0.width, self.0.height) / self.0.width as f64;
        match (self.alignment(&here, &there), self.alignment(&there, &here)) {
            (Some(there), Some(back)) => {
                let (share, error) = (size(&there).min(size(&back)), size(&there.then(&back)));
                Some(Displacement { share, error })
            }
            (Some(only), None) | (None, Some(only)) => {
                Some(Displacement { share: size(&only), error: f64::INFINITY })
            }
            (None, None) => None,
        }
    }

    /// Aligns `picture` with `from`. Both have the size of `self`.
    fn alignment(&self, from: &Prepared, picture: &Prepared) -> Option<Alignment> {
        let reference = Reference::new(from);
        let shifts = reference.measured(picture).fine;
        let alignment = Alignment::of(&shifts).filter(|alignment| {
            let along = shifts.iter().filter(|block| {
                block.shift.is_some_and(|shift| (shift - alignment.at(&block.centre)).norm() < NEAR)
            });
            along.count() as f64 >= MIN_SHARE * shifts.len() as f64
        });
        alignment.or_else(|| {
            let found = search(reference.fine(), picture.smooth())?;
            let carried = refined(reference.fine(), picture.smooth(), &found);
            let middle = Vector2::new(self.0.width as f64, self.0.height as f64) / 2.0;
            Some(Alignment::from_similarity(&carried, &middle))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a pseudo-random number, 0–1.
    fn drawn(night: u64, index: u64) -> f64 {
        let mut hash = (night * 100_000 + index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        hash = (hash ^ (hash >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        ((hash ^ (hash >> 32)) % 10_000) as f64 / 1e4
    }

    /// Draws a car park whose lines and trees have this contrast, grey levels. Half of the bays contain a car; the
    /// occupied bays differ from night to night. A turn of the camera shifts the picture by `turned_px`.
    fn lot(night: u64, contrast: f64, turned_px: f64) -> BackgroundPicture {
        let mut picture = GrayImage::from_fn(240, 135, |column, row| {
            let (x, y) = (f64::from(column) + turned_px, f64::from(row));
            let line = (x + 0.4 * y).rem_euclid(16.0) < 1.5 && row % 40 > 20;
            let tree = (x.rem_euclid(37.0) - 12.0).hypot(y - 8.0) < 5.0;
            let noise = 3.0 * drawn(night, u64::from(row * 240 + column));
            let value = 120.0 + contrast * (f64::from(u8::from(line)) - f64::from(u8::from(tree))) + noise;
            image::Luma([value as u8])
        });
        for bay in 0..42_u32 {
            let drawn = |index: u64| drawn(night, 50_000 + 10 * u64::from(bay) + index);
            let x = f64::from(bay % 14) * 16.0 + 12.0 - turned_px + 4.0 * drawn(0);
            let y = bay / 14 * 40 + 24 + (4.0 * drawn(1)) as u32;
            if drawn(2) < 0.5 && (0.0..228.0).contains(&x) {
                let grey = image::Luma([60 + (160.0 * drawn(3)) as u8]);
                (0..88).for_each(|i| picture.put_pixel(x as u32 + i % 11, y + i / 11, grey));
            }
        }
        BackgroundPicture::from_grey(&picture)
    }

    #[test]
    fn other_parked_cars_are_no_turned_camera() {
        // In haze, the cars have the strongest contrast.
        for (contrast, least) in [(22.0, 3), (40.0, 30)] {
            let nights: Vec<BackgroundPicture> = (0..12).map(|night| lot(night, contrast, 0.0)).collect();
            let pairs = nights.iter().enumerate().flat_map(|(i, a)| nights[..i].iter().map(move |b| (a, b)));
            let compared: Vec<Displacement> = pairs.filter_map(|(a, b)| a.displacement(b)).collect();
            assert!(compared.len() >= least, "{contrast}: {}", compared.len());
            assert!(compared.iter().all(|d| d.share - d.error <= 0.003), "{contrast}: {compared:?}");
        }
        let Displacement { share, error } = lot(0, 40.0, 0.0).displacement(&lot(0, 40.0, 9.0)).unwrap();
        assert!((share - 9.0 / 240.0).abs() < 0.004 && error < 0.004, "{share} {error}");
    }
}
