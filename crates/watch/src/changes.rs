//! Finds the cells that changed since the detector last inspected them.
//!
//! Each picture is compared cell by cell with the pictures that the detector inspected last. The threshold of each cell
//! adapts to the scene. It follows the noise from one picture to the next. It also follows earlier changes that turned
//! out to be no vehicle: leaves in the wind, key frames of the codec, rain, glare of headlights. Both fade within a
//! minute.

use nalgebra::Vector2;
use roadplane_base::upper_median;

use crate::SmallGrey;

/// Side of a cell, px of the small picture.
pub const CELL_PX: usize = 8;

/// Smallest mean change of a cell that counts where there is no noise, grey levels.
const LEAST: f32 = 1.2;
/// Multiple of the noise that is added for its scatter in a whole cell; the mean of fewer pixels scatters more.
const SCATTER: f32 = 0.8;
/// Noise of each cell before the first picture, grey levels.
const FIRST_NOISE: f32 = 2.0;
/// Factor by which a cell's noise estimate rises after a larger change from picture to picture. With [`DOWN`] the
/// estimate follows the lower quartile of the changes.
const UP: f32 = 1.012;
/// Factor by which a cell's noise estimate falls after a smaller change.
const DOWN: f32 = 0.97;
/// Largest noise of a cell, in units of the picture's median: traffic is no noise.
const MOST_NOISE: f32 = 3.0;
/// Share by which the nuisance level of a cell approaches [`ABOVE`] times a change that was no vehicle.
const LEARN: f32 = 0.5;
/// Highest nuisance level after a change that was no vehicle, as a multiple of this change.
const ABOVE: f32 = 1.25;
/// Highest nuisance level, grey levels: a vehicle exceeds it.
const MOST_NUISANCE: f32 = 12.0;
/// Time in which the nuisance level fades to a third, s.
const FADE_S: f64 = 15.0;
/// Smallest shift of the picture that is corrected, px of the small picture.
const STILL: f64 = 0.04;

/// A set of cells in a grid over the picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cells {
    /// Number of cells in a row.
    pub columns: usize,
    /// Number of rows of cells.
    pub rows: usize,
    /// Side of a cell, px of the frame.
    pub side_px: usize,
    is_in: Vec<bool>,
}

impl Cells {
    fn none(columns: usize, rows: usize, side_px: usize) -> Self {
        Self { columns, rows, side_px, is_in: vec![false; columns * rows] }
    }

    /// Returns an empty set in the same grid.
    #[must_use]
    pub fn emptied(&self) -> Self {
        Self::none(self.columns, self.rows, self.side_px)
    }

    /// Whether a cell is in the set.
    #[must_use]
    pub fn has(&self, column: usize, row: usize) -> bool {
        self.is_in[row * self.columns + column]
    }

    /// Adds a cell to the set.
    pub fn insert(&mut self, column: usize, row: usize) {
        self.is_in[row * self.columns + column] = true;
    }

    /// Returns the share of the grid's cells that are in the set, 0–1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.is_in.iter().filter(|is_in| **is_in).count() as f64 / self.is_in.len().max(1) as f64
    }

    /// Returns the columns and rows of the cells that a box (left, top, right, bottom, px of the frame) touches.
    #[must_use]
    pub fn touched(&self, bbox_px: &[f64; 4]) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let span = |from: f64, to: f64, count: usize| {
            let cell = |at: f64| (at.max(0.0) / self.side_px as f64) as usize;
            if to < 0.0 {
                return 0..0;
            }
            let first = cell(from).min(count);
            first..(cell(to) + 1).clamp(first, count)
        };
        (span(bbox_px[0], bbox_px[2], self.columns), span(bbox_px[1], bbox_px[3], self.rows))
    }

    /// Iterates over the columns and rows of the cells in the set, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let is_in = self.is_in.iter().enumerate().filter(|(_, is_in)| **is_in);
        is_in.map(|(cell, _)| (cell % self.columns, cell / self.columns))
    }

    /// Iterates over the columns and rows of a cell and its neighbours, row by row.
    pub fn around(&self, column: usize, row: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
        let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }

    /// Whether a cell lies at the picture's border, or next to one that does.
    #[must_use]
    pub fn is_at_border(&self, column: usize, row: usize) -> bool {
        column < 2 || row < 2 || column + 2 >= self.columns || row + 2 >= self.rows
    }

    /// Returns the share of the cells touched by a box that are in the set, 0–1.
    #[must_use]
    pub fn share_of(&self, bbox_px: &[f64; 4]) -> f64 {
        let (columns, rows) = self.touched(bbox_px);
        let count = columns.len() * rows.len();
        let here =
            rows.map(|row| columns.clone().filter(|column| self.has(*column, row)).count()).sum::<usize>();
        here as f64 / count.max(1) as f64
    }

    /// Adds all cells that a box touches.
    pub fn insert_box(&mut self, bbox_px: &[f64; 4]) {
        self.set_box(bbox_px, true);
    }

    /// Removes all cells that a box touches.
    pub fn remove_box(&mut self, bbox_px: &[f64; 4]) {
        self.set_box(bbox_px, false);
    }

    fn set_box(&mut self, bbox_px: &[f64; 4], is_in: bool) {
        let (columns, rows) = self.touched(bbox_px);
        for row in rows {
            self.is_in[row * self.columns..][columns.clone()].fill(is_in);
        }
    }

    /// Returns boxes (px of the frame) around groups of neighbouring cells, ordered by their first cell. Diagonal
    /// neighbours count.
    #[must_use]
    pub fn groups(&self) -> Vec<[f64; 4]> {
        let mut seen = vec![false; self.is_in.len()];
        let mut found = Vec::new();
        let mut open = Vec::new();
        for start in 0..self.is_in.len() {
            if !self.is_in[start] || seen[start] {
                continue;
            }
            seen[start] = true;
            open.push(start);
            let mut span = [usize::MAX, usize::MAX, 0, 0];
            while let Some(cell) = open.pop() {
                let (column, row) = (cell % self.columns, cell / self.columns);
                span = [span[0].min(column), span[1].min(row), span[2].max(column + 1), span[3].max(row + 1)];
                for (x, y) in self.around(column, row) {
                    let next = y * self.columns + x;
                    if self.is_in[next] && !seen[next] {
                        seen[next] = true;
                        open.push(next);
                    }
                }
            }
            found.push(span.map(|edge| (edge * self.side_px) as f64));
        }
        found
    }
}

/// Compares pictures with the content that the detector inspected last, and learns which cells change all the time.
#[derive(Clone, Debug)]
pub struct ChangeMap {
    columns: usize,
    rows: usize,
    factor: usize,
    /// The previous picture.
    before: SmallGrey,
    /// The content that the detector inspected last; cells come from different pictures.
    inspected: SmallGrey,
    /// Shift of the picture when each cell was inspected.
    inspected_shift: Vec<Vector2<f64>>,
    /// Mean change of each cell of this picture against the inspected content, grey levels.
    change: Vec<f32>,
    noise: Vec<f32>,
    /// Scatter factor of each cell's noise; cells at the right and the bottom may be smaller and scatter more.
    scatter: Vec<f32>,
    nuisance: Vec<f32>,
    last_s: Option<f64>,
    pictures: u32,
}

impl ChangeMap {
    /// Creates a map for pictures of this size, before any inspection.
    #[must_use]
    pub fn new(small: &SmallGrey) -> Self {
        let (columns, rows) = (small.width.div_ceil(CELL_PX), small.height.div_ceil(CELL_PX));
        let cells = columns * rows;
        let scatter = (0..cells).map(|cell| {
            let side = |at: usize, length: usize| (length - at * CELL_PX).min(CELL_PX);
            let pixels = side(cell % columns, small.width) * side(cell / columns, small.height);
            SCATTER * CELL_PX as f32 / (pixels as f32).sqrt()
        });
        Self {
            columns,
            rows,
            factor: small.factor,
            before: small.clone(),
            inspected: small.clone(),
            inspected_shift: vec![Vector2::zeros(); cells],
            change: vec![0.0; cells],
            noise: vec![FIRST_NOISE; cells],
            scatter: scatter.collect(),
            nuisance: vec![0.0; cells],
            last_s: None,
            pictures: 0,
        }
    }

    /// Whether the map was created for pictures of this size.
    #[must_use]
    pub fn suits(&self, small: &SmallGrey) -> bool {
        self.before.same_size(small)
    }

    /// Returns an empty set of cells in the grid of this map.
    #[must_use]
    pub fn no_cells(&self) -> Cells {
        Cells::none(self.columns, self.rows, CELL_PX * self.factor)
    }

    /// Returns the set of all cells in the grid of this map.
    #[must_use]
    pub fn all_cells(&self) -> Cells {
        let mut cells = self.no_cells();
        cells.is_in.fill(true);
        cells
    }

    /// Compares the next picture and returns the cells that changed since their inspection. `shift` is the shift of the
    /// picture against the background, px of the small picture.
    pub fn changed(&mut self, small: &SmallGrey, shift: Vector2<f64>, time_s: f64) -> Cells {
        self.pictures = self.pictures.saturating_add(1);
        let fade = self.last_s.map_or(1.0, |last| (-(time_s - last).max(0.0) / FADE_S).exp()) as f32;
        self.last_s = Some(time_s);
        self.learn_noise(small);
        self.compare(small, shift);
        let most = MOST_NOISE * upper_median(&mut self.noise.clone(), f32::total_cmp).unwrap_or(0.0);
        let mut cells = self.no_cells();
        for cell in 0..self.change.len() {
            self.nuisance[cell] *= fade;
            let noise = self.noise[cell].min(most) * (1.0 + self.scatter[cell]);
            let bar = (LEAST + noise).max(self.nuisance[cell]);
            cells.is_in[cell] = self.change[cell] > bar;
        }
        cells
    }

    /// Marks the cells of `region` as inspected in this picture. `vehicles` are the cells of the boxes found there, weak
    /// ones included. A change in any other inspected cell was no vehicle.
    pub fn mark_inspected(
        &mut self,
        small: &SmallGrey,
        shift: Vector2<f64>,
        region: &Cells,
        vehicles: &Cells,
    ) {
        for row in 0..self.rows {
            for column in 0..self.columns {
                if !region.has(column, row) {
                    continue;
                }
                let cell = row * self.columns + column;
                let missing = ABOVE * self.change[cell] - self.nuisance[cell];
                if !vehicles.has(column, row) && missing > 0.0 {
                    self.nuisance[cell] = (self.nuisance[cell] + LEARN * missing).min(MOST_NUISANCE);
                }
                self.inspected_shift[cell] = shift;
                for y in row * CELL_PX..((row + 1) * CELL_PX).min(small.height) {
                    let from = y * small.width + column * CELL_PX;
                    let to = y * small.width + ((column + 1) * CELL_PX).min(small.width);
                    self.inspected.values[from..to].copy_from_slice(&small.values[from..to]);
                }
            }
        }
    }

    fn learn_noise(&mut self, small: &SmallGrey) {
        let changes = cell_means(&self.before.values, &small.values, small.width, self.columns, self.rows);
        // The estimate adapts faster in the first pictures, which carry the most information.
        let speed = if self.pictures < 20 { 8.0 } else { 1.0 };
        let (up, down) = (UP.powf(speed), DOWN.powf(speed));
        for (noise, change) in self.noise.iter_mut().zip(changes) {
            *noise = (*noise * if change > *noise { up } else { down }).clamp(0.05, 40.0);
        }
        self.before.values.copy_from_slice(&small.values);
    }

    fn compare(&mut self, small: &SmallGrey, shift: Vector2<f64>) {
        self.change = cell_means(&self.inspected.values, &small.values, small.width, self.columns, self.rows);
        for row in 0..self.rows {
            for column in 0..self.columns {
                let cell = row * self.columns + column;
                let shaken = shift - self.inspected_shift[cell];
                if shaken.norm() > STILL && self.change[cell] > LEAST {
                    self.change[cell] = self.unshaken(small, column, row, shaken);
                }
            }
        }
    }

    /// Mean change of a cell after the picture's shift is taken out: `I(x) − S(x − d) ≈ I − S + ∇I·d`.
    fn unshaken(&self, small: &SmallGrey, column: usize, row: usize, shaken: Vector2<f64>) -> f32 {
        let (width, height) = (small.width, small.height);
        let (dx, dy) = (shaken.x as f32, shaken.y as f32);
        let (mut sum, mut count) = (0.0, 0.0);
        for y in (row * CELL_PX).max(1)..((row + 1) * CELL_PX).min(height - 1) {
            for x in (column * CELL_PX).max(1)..((column + 1) * CELL_PX).min(width - 1) {
                let at = |x: usize, y: usize| f32::from(small.values[y * width + x]);
                let gradient =
                    0.5 * ((at(x + 1, y) - at(x - 1, y)) * dx + (at(x, y + 1) - at(x, y - 1)) * dy);
                sum += (at(x, y) - f32::from(self.inspected.values[y * width + x]) + gradient).abs();
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }
}

/// Returns the mean absolute difference in each cell, grey levels.
fn cell_means(a: &[u8], b: &[u8], width: usize, columns: usize, rows: usize) -> Vec<f32> {
    let mut sums = vec![0_u32; columns * rows];
    let mut counts = vec![0_u32; columns * rows];
    for (y, (a, b)) in a.chunks_exact(width).zip(b.chunks_exact(width)).enumerate() {
        let cells = (y / CELL_PX) * columns..(y / CELL_PX + 1) * columns;
        let pieces = a.chunks(CELL_PX).zip(b.chunks(CELL_PX));
        for ((sum, count), (a, b)) in sums[cells.clone()].iter_mut().zip(&mut counts[cells]).zip(pieces) {
            *sum += a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>();
            *count += a.len() as u32;
        }
    }
    sums.iter().zip(&counts).map(|(sum, count)| *sum as f32 / (*count).max(1) as f32).collect()
}
