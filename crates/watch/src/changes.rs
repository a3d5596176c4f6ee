//! Finds the cells (squares of the picture) that changed since the vehicle detector last inspected them.
//!
//! Each picture is compared cell by cell with the content that the detector inspected last. If the camera moves, the
//! picture is first laid on a keyframe ([`View`]), to which the cells belong. Every cell has its own
//! threshold for a change. The threshold rises with the noise between consecutive pictures. It also rises after a
//! change that was no vehicle, such as leaves in the wind, codec key frames, rain or glare of headlights. Both effects
//! fade within a minute.

use roadplane_base::upper_median;

use crate::{SmallGrey, View};

/// Side of a square cell, px of the reduced picture.
pub const CELL_PX: usize = 8;

/// Threshold for the mean change of a cell without noise, grey levels.
const LEAST: f32 = 1.2;
/// Margin for the scatter of a full cell's mean change, as a share of the cell's noise. A cell with fewer pixels gets a
/// larger margin.
const SCATTER: f32 = 0.8;
/// Initial noise estimate of each cell, grey levels.
const FIRST_NOISE: f32 = 2.0;
/// Factor by which a cell's noise estimate rises if the change between two pictures is larger than the estimate.
/// Together with [`DOWN`], it makes the estimate follow the lower quartile of these changes.
const UP: f32 = 1.012;
/// Factor by which a cell's noise estimate falls if the change between two pictures is smaller than the estimate.
const DOWN: f32 = 0.97;
/// Largest noise of a cell, as a multiple of the median over all cells. This limit keeps traffic from counting as
/// noise.
const MOST_NOISE: f32 = 3.0;
/// Step by which a cell's nuisance level rises in one update, as a share of its distance from the target. The nuisance
/// level is a threshold that the cell learns from changes that were no vehicle. The target is [`ABOVE`] times the last
/// of these changes.
const LEARN: f32 = 0.5;
/// Target of a cell's nuisance level (see [`LEARN`]), as a multiple of the cell's last change without a vehicle.
const ABOVE: f32 = 1.25;
/// Highest nuisance level of a cell (see [`LEARN`]), grey levels. The change that a vehicle causes is larger.
const MOST_NUISANCE: f32 = 12.0;
/// Time constant with which a cell's nuisance level (see [`LEARN`]) decays, s.
const FADE_S: f64 = 15.0;

/// A set of cells in a grid over the picture, or over a keyframe.
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

    /// Returns the columns and the rows of the cells that a box touches. The box is given as left, top, right, bottom,
    /// px of the frame.
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

    /// Returns a cell as a box, px of the frame.
    #[must_use]
    pub fn cell_px(&self, column: usize, row: usize) -> [f64; 4] {
        let [x, y] = [column, row].map(|at| (at * self.side_px) as f64);
        [x, y, x + self.side_px as f64, y + self.side_px as f64]
    }

    /// Iterates over the column and the row of every cell in the set, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let is_in = self.is_in.iter().enumerate().filter(|(_, is_in)| **is_in);
        is_in.map(|(cell, _)| (cell % self.columns, cell / self.columns))
    }

    /// Iterates over the column and the row of a cell and of each of its neighbours, row by row.
    pub fn around(&self, column: usize, row: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
        let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }

    /// Whether a cell is in the outer two columns or the outer two rows of the grid.
    #[must_use]
    pub fn is_at_border(&self, column: usize, row: usize) -> bool {
        column < 2 || row < 2 || column + 2 >= self.columns || row + 2 >= self.rows
    }

    /// Returns the share (0–1) of the cells under a box that are in the set.
    #[must_use]
    pub fn share_of(&self, bbox_px: &[f64; 4]) -> f64 {
        let (columns, rows) = self.touched(bbox_px);
        let count = columns.len() * rows.len();
        let here =
            rows.map(|row| columns.clone().filter(|column| self.has(*column, row)).count()).sum::<usize>();
        here as f64 / count.max(1) as f64
    }

    /// Adds all cells that a box (px of the frame) touches to the set.
    pub fn insert_box(&mut self, bbox_px: &[f64; 4]) {
        self.set_box(bbox_px, true);
    }

    /// Removes all cells that a box (px of the frame) touches from the set.
    pub fn remove_box(&mut self, bbox_px: &[f64; 4]) {
        self.set_box(bbox_px, false);
    }

    fn set_box(&mut self, bbox_px: &[f64; 4], is_in: bool) {
        let (columns, rows) = self.touched(bbox_px);
        for row in rows {
            self.is_in[row * self.columns..][columns.clone()].fill(is_in);
        }
    }

    /// Returns the bounding box of each group of connected cells, px of the frame. Cells that touch at a corner are
    /// connected, too. The boxes have the order of the first cells of their groups.
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

/// Compares each picture with the content that the detector inspected last, and learns which cells change all the time.
#[derive(Clone, Debug)]
pub struct ChangeMap {
    columns: usize,
    rows: usize,
    factor: usize,
    /// The last picture, as it lies on the keyframe.
    laid: SmallGrey,
    /// The content of each cell in the last picture that showed the whole cell.
    before: SmallGrey,
    /// The content of each cell at the detector's last inspection. Different cells may come from different pictures.
    inspected: SmallGrey,
    /// Mean difference between each cell of the current picture and its inspected content, grey levels.
    change: Vec<f32>,
    noise: Vec<f32>,
    /// Margin for the scatter of each cell's mean change, as a share of the cell's noise. Cells at the right and the
    /// bottom may have fewer pixels and then have a larger margin.
    scatter: Vec<f32>,
    nuisance: Vec<f32>,
    last_s: Option<f64>,
    pictures: u32,
}

impl ChangeMap {
    /// Creates a map for pictures of the size of `small`. No cell has been inspected yet.
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
            laid: small.clone(),
            before: small.clone(),
            inspected: small.clone(),
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

    /// Returns the cells of the keyframe that changed since their last inspection. `view` is how the next picture shows
    /// the keyframe. Parts that the picture does not show have not changed.
    pub fn changed(&mut self, small: &SmallGrey, view: &View, time_s: f64) -> Cells {
        self.pictures = self.pictures.saturating_add(1);
        let fade = self.last_s.map_or(1.0, |last| (-(time_s - last).max(0.0) / FADE_S).exp()) as f32;
        self.last_s = Some(time_s);
        self.laid = view.laid(small, &self.inspected);
        self.learn_noise(view);
        let (seen, now) = (&self.inspected.values, &self.laid.values);
        self.change = cell_means(seen, now, small.width, self.columns, self.rows);
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

    /// Marks the cells of `region` as inspected in the last picture.
    ///
    /// `vehicles` are the cells under the detected boxes, including boxes with low scores. A change in an inspected
    /// cell outside `vehicles` was no vehicle, and it raises the cell's threshold.
    pub fn mark_inspected(&mut self, region: &Cells, vehicles: &Cells) {
        for (column, row) in region.iter() {
            let cell = row * self.columns + column;
            let missing = ABOVE * self.change[cell] - self.nuisance[cell];
            if !vehicles.has(column, row) && missing > 0.0 {
                self.nuisance[cell] = (self.nuisance[cell] + LEARN * missing).min(MOST_NUISANCE);
            }
            copy_cell(&mut self.inspected, &self.laid, column, row);
        }
    }

    /// Learns the noise of the cells that the last picture shows as a whole.
    fn learn_noise(&mut self, view: &View) {
        let (before, now) = (&self.before.values, &self.laid.values);
        let changes = cell_means(before, now, self.laid.width, self.columns, self.rows);
        // The estimate adapts faster in the first pictures, because it starts from a rough guess.
        let speed = if self.pictures < 20 { 8.0 } else { 1.0 };
        let (up, down) = (UP.powf(speed), DOWN.powf(speed));
        let all = self.all_cells();
        for (column, row) in all.iter().filter(|(column, row)| view.shows(&all.cell_px(*column, *row))) {
            let cell = row * self.columns + column;
            let (noise, change) = (&mut self.noise[cell], changes[cell]);
            *noise = (*noise * if change > *noise { up } else { down }).clamp(0.05, 40.0);
            copy_cell(&mut self.before, &self.laid, column, row);
        }
    }
}

/// Copies the pixels of a cell.
fn copy_cell(to: &mut SmallGrey, from: &SmallGrey, column: usize, row: usize) {
    for y in row * CELL_PX..((row + 1) * CELL_PX).min(from.height) {
        let pixels =
            y * from.width + column * CELL_PX..y * from.width + ((column + 1) * CELL_PX).min(from.width);
        to.values[pixels.clone()].copy_from_slice(&from.values[pixels]);
    }
}

/// Returns the mean absolute difference of two pictures in each cell, grey levels.
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
