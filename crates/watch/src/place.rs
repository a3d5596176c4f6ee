//! The empty place as a small picture, to tell from another clip's whether the camera hangs as it did.

use image::{GrayImage, RgbImage};
use nalgebra::Vector2;

use crate::alignment::Alignment;
use crate::reference::{Prepared, Reference};
use crate::search::{refined, search};
use crate::{SmallGrey, WatchError};

/// Longest side, px: a turn by 2° is some ten pixels of it.
const LONGEST: usize = 240;
/// Share of the blocks that must go along with a shift: a clock in the picture stays where it is when the camera is turned.
const MIN_SHARE: f64 = 0.25;
/// A block goes along within this, px.
const NEAR: f64 = 0.7;

/// A picture of the empty place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlacePicture(SmallGrey);

impl PlacePicture {
    /// Of a frame without what moves.
    ///
    /// # Errors
    /// [`WatchError`] when OpenCV fails.
    pub fn of(place: &RgbImage) -> Result<Self, WatchError> {
        let small = SmallGrey::of(place)?;
        Ok(Self(if small.width.max(small.height) > LONGEST { small.halved() } else { small }))
    }

    /// As it was kept.
    #[must_use]
    pub fn from_grey(image: &GrayImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        Self(SmallGrey { width, height, factor: 1, values: image.as_raw().clone() })
    }

    /// To be kept.
    #[must_use]
    pub fn to_grey(&self) -> GrayImage {
        let Self(small) = self;
        GrayImage::from_fn(small.width as u32, small.height as u32, |x, y| {
            image::Luma([small.row(y as usize)[x as usize]])
        })
    }

    /// How far what is in this picture lies off in another, root mean square over the picture, as a share of its width. `None`
    /// where they cannot be laid on each other: another light, another place, another size.
    #[must_use]
    pub fn displacement(&self, other: &Self) -> Option<f64> {
        if !self.0.same_size(&other.0) || self.0.width < 32 || self.0.height < 32 {
            return None;
        }
        let (width, height) = (self.0.width as f64, self.0.height as f64);
        let reference = Reference::new(&Prepared::of(&self.0));
        let picture = Prepared::of(&other.0);
        let told = reference.told(&picture).fine;
        if let Some(alignment) = Alignment::of(&told) {
            let along = told.iter().filter(|block| {
                block.shift.is_some_and(|shift| (shift - alignment.at(&block.centre)).norm() < NEAR)
            });
            if along.count() as f64 >= MIN_SHARE * told.len() as f64 {
                return Some(alignment.displacement(self.0.width, self.0.height) / width);
            }
        }
        let found = search(reference.fine(), picture.smooth())?;
        let carried = refined(reference.fine(), picture.smooth(), &found);
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
        let squares = corners.map(|(u, v)| {
            let corner = Vector2::new(u * width, v * height);
            (carried.apply(&corner) - corner).norm_squared()
        });
        Some((squares.iter().sum::<f64>() / 4.0).sqrt() / width)
    }
}
