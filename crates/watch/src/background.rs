//! A picture of the empty scene. Each part of it comes from times at which nothing moved there.

use image::RgbImage;
use nalgebra::Vector2;
use roadplane_base::{ImageSize, Registration};

use crate::mean_view::MeanView;
use crate::{Cells, View};

/// Interval at which an empty cell is blended into the background again, s.
const RENEW_S: f64 = 2.0;
/// Inverse of the weight with which a new picture is blended in: the new picture counts a quarter. Thereby noise
/// averages out, and the background follows changes of light.
const SHARE: u16 = 4;

/// The background of a clip at full size, as a keyframe of the place shows it.
#[derive(Clone, Debug)]
pub struct Background {
    picture: RgbImage,
    /// Index of the keyframe's frame.
    keyframe: Option<u64>,
    /// Index of the frame on which the first picture is registered.
    reference: Option<u64>,
    /// Mean position of the pictures on the keyframe.
    mean: MeanView,
    grid: Cells,
    /// Time at which each cell was last blended in, s; `None` if the cell was never empty.
    bare_s: Vec<Option<f64>>,
}

/// A picture of the empty scene.
#[derive(Clone, Debug)]
pub struct EmptyScene {
    /// The picture, at full size.
    pub picture: RgbImage,
    /// How the picture lies on the picture of an earlier frame. `None` if the clip has too little structure. Then the
    /// camera counts as at rest.
    pub registration: Option<Registration>,
}

impl Background {
    /// Creates a background from the first picture. No cell counts as empty yet.
    #[must_use]
    pub fn new(picture: &RgbImage, view: &View, grid: Cells) -> Self {
        let cells = grid.columns * grid.rows;
        let View { keyframe, reference, .. } = *view;
        let (mean, bare_s) = (MeanView::default(), vec![None; cells]);
        let mut background = Self { picture: picture.clone(), keyframe, reference, mean, grid, bare_s };
        if view.is_displaced() {
            for cell in 0..cells {
                let (column, row) = (cell % background.grid.columns, cell / background.grid.columns);
                background.blend(picture, view, column, row, true);
            }
        }
        background
    }

    /// Returns the number of cells that were empty at some time.
    #[must_use]
    pub fn bare_count(&self) -> usize {
        self.bare_s.iter().flatten().count()
    }

    /// Returns the index of the keyframe's frame; see [`View::keyframe`].
    #[must_use]
    pub fn keyframe(&self) -> Option<u64> {
        self.keyframe
    }

    /// Blends the empty cells of a picture into the background. A cell is empty if it is not in `busy`. The picture
    /// must show the keyframe of the background.
    pub fn take(&mut self, picture: &RgbImage, view: &View, busy: &Cells, time_s: f64) {
        if picture.dimensions() != self.picture.dimensions() {
            return;
        }
        self.mean.add(view, time_s);
        for row in 0..self.grid.rows {
            for column in 0..self.grid.columns {
                let cell = row * self.grid.columns + column;
                let is_due = self.bare_s[cell].is_none_or(|last| time_s - last >= RENEW_S);
                if is_due && !busy.has(column, row) && view.shows(&self.grid.cell_px(column, row)) {
                    self.blend(picture, view, column, row, self.bare_s[cell].is_none());
                    self.bare_s[cell] = Some(time_s);
                }
            }
        }
    }

    fn blend(&mut self, picture: &RgbImage, view: &View, column: usize, row: usize, is_first: bool) {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let side = self.grid.side_px;
        // The last column and the last row also include the pixels that do not fill a whole cell.
        let end = |cell: usize, count: usize, length: usize| {
            if cell + 1 == count { length } else { ((cell + 1) * side).min(length) }
        };
        let columns = (column * side).min(width)..end(column, self.grid.columns, width);
        let mut shown = vec![0; 3 * columns.len()];
        for y in (row * side).min(height)..end(row, self.grid.rows, height) {
            let bytes = 3 * (y * width + columns.start)..3 * (y * width + columns.end);
            let new: &[u8] = if view.is_displaced() {
                for (x, pixel) in columns.clone().zip(shown.chunks_exact_mut(3)) {
                    let from = view.picture_from_keyframe.apply(&Vector2::new(x as f64, y as f64));
                    pixel.copy_from_slice(&interpolated(picture, &from));
                }
                &shown
            } else {
                &picture.as_raw()[bytes.clone()]
            };
            let pixels: &mut [u8] = &mut self.picture;
            let old = &mut pixels[bytes];
            if is_first {
                old.copy_from_slice(new);
            } else {
                for (old, new) in old.iter_mut().zip(new) {
                    let sum = u16::from(*old) * (SHARE - 1) + u16::from(*new) + SHARE / 2;
                    *old = (sum / SHARE) as u8;
                }
            }
        }
    }

    /// Returns the picture of the background. Cells that were never empty come from the first frame.
    #[must_use]
    pub fn picture(&self) -> &RgbImage {
        &self.picture
    }

    /// Returns the background as the mean position of the last pictures shows it.
    #[must_use]
    pub fn empty_scene(&self) -> EmptyScene {
        let registration = self.reference.map(|reference| self.mean.registration(reference));
        let mut picture = self.picture.clone();
        if let Some(mean) = registration.filter(|mean| mean.homography.is_some()) {
            let size = ImageSize { width: picture.width(), height: picture.height() };
            let keyframe_from_mean = mean.picture_from_reference(size).inverse();
            for (x, y, pixel) in picture.enumerate_pixels_mut() {
                let at = keyframe_from_mean.apply(&Vector2::new(f64::from(x), f64::from(y)));
                pixel.0 = interpolated(&self.picture, &at);
            }
        }
        EmptyScene { picture, registration }
    }

    /// Returns the time at which each cell was last blended into the background, s, row by row. A cell that was never
    /// empty has `None`.
    #[must_use]
    pub fn bare_s(&self) -> Vec<Vec<Option<f64>>> {
        self.bare_s.chunks(self.grid.columns.max(1)).map(<[_]>::to_vec).collect()
    }

    /// Returns the side of a cell, px of the frame.
    #[must_use]
    pub fn cell_px(&self) -> usize {
        self.grid.side_px
    }
}

/// Returns the colour at a point of a picture, by bilinear interpolation. Outside the picture, it is that of the nearest
/// pixel.
fn interpolated(picture: &RgbImage, at: &Vector2<f64>) -> [u8; 3] {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let clamped = |at: f64, length: usize| at.clamp(0.0, length as f64 - 1.0);
    let (x, y) = (clamped(at.x, width), clamped(at.y, height));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let (u, v) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let pixels = picture.as_raw();
    std::array::from_fn(|channel| {
        let value = |x: usize, y: usize| f32::from(pixels[3 * (y * width + x) + channel]);
        let mix = |y: usize| value(x0, y) * (1.0 - u) + value(x1, y) * u;
        (mix(y0) * (1.0 - v) + mix(y1) * v).round() as u8
    })
}
