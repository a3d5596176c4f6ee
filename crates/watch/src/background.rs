//! A picture of the empty scene. Each part of it comes from times at which nothing moved there.

use image::RgbImage;

use crate::Cells;

/// Interval at which an empty cell is blended into the background again, s.
const RENEW_S: f64 = 2.0;
/// Inverse of the weight with which a new picture is blended in: the new picture counts a quarter. Thereby noise
/// averages out, and the background follows changes of light.
const SHARE: u16 = 4;

/// The background of a clip at full size.
#[derive(Clone, Debug)]
pub struct Background {
    picture: RgbImage,
    grid: Cells,
    /// Time at which each cell was last blended in, s; `None` if the cell was never empty.
    bare_s: Vec<Option<f64>>,
}

impl Background {
    /// Creates a background from the first picture. No cell counts as empty yet.
    #[must_use]
    pub fn new(picture: &RgbImage, grid: Cells) -> Self {
        let cells = grid.columns * grid.rows;
        Self { picture: picture.clone(), grid, bare_s: vec![None; cells] }
    }

    /// Blends the empty cells of a picture into the background. A cell is empty if it is not in `busy`.
    pub fn take(&mut self, picture: &RgbImage, busy: &Cells, time_s: f64) {
        if picture.dimensions() != self.picture.dimensions() {
            return;
        }
        for row in 0..self.grid.rows {
            for column in 0..self.grid.columns {
                let cell = row * self.grid.columns + column;
                let is_due = self.bare_s[cell].is_none_or(|last| time_s - last >= RENEW_S);
                if is_due && !busy.has(column, row) {
                    self.blend(picture, column, row, self.bare_s[cell].is_none());
                    self.bare_s[cell] = Some(time_s);
                }
            }
        }
    }

    fn blend(&mut self, picture: &RgbImage, column: usize, row: usize, is_first: bool) {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let side = self.grid.side_px;
        // The last column and the last row also include the pixels that do not fill a whole cell.
        let end = |cell: usize, count: usize, length: usize| {
            if cell + 1 == count { length } else { ((cell + 1) * side).min(length) }
        };
        let columns = (column * side).min(width)..end(column, self.grid.columns, width);
        for y in (row * side).min(height)..end(row, self.grid.rows, height) {
            let bytes = 3 * (y * width + columns.start)..3 * (y * width + columns.end);
            let pixels: &mut [u8] = &mut self.picture;
            let (old, new) = (&mut pixels[bytes.clone()], &picture.as_raw()[bytes]);
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
