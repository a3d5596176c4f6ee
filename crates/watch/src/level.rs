//! The background of a camera at rest at one size, cut into blocks. Each block measures its shift in a picture.
//!
//! In a block, the picture I equals the reference R, shifted by d, with a gain a and an offset b:
//!
//! `I(x) = a R(x − d) + b ≈ a R − a ∇R·d + b`
//!
//! The least-squares problem in (a, b, a d) has a normal matrix that depends on the reference alone. A picture
//! therefore costs only four products per pixel (Lucas & Kanade 1981, with gain and offset).

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::PictureMotion;

use crate::SmallGrey;

/// Side of a block, px of the reduced picture.
pub(crate) const BLOCK: usize = 16;
/// Smallest mean squared gradient of a block along its weaker direction, (grey levels per px)². Below this limit, noise
/// and codec artefacts would count as structure.
const MIN_STRUCTURE: f64 = 4.0;
/// Smallest number of blocks in each field of a 3 × 3 grid over a picture that has structure everywhere.
const MIN_IN_NINTH: usize = 3;
/// Time constant of a block's trust, s. Trust is the running share of pictures in which the block measured a shift. The
/// constant is longer than a large vehicle takes to drive past.
const TRUST_S: f64 = 3.0;
/// Smallest trust of a block that is used. Blocks of noise, leaves or bare road stay below this limit.
const TRUSTED: f64 = 0.4;
/// Initial trust of a new block. It is below [`TRUSTED`], so a new block is not used at once.
const NEW_TRUST: f64 = 0.3;
/// Smallest share of a block's variance that the shift, the gain and the offset must explain. Below this limit, the
/// picture shows something else there.
const MIN_EXPLAINED: f64 = 0.55;
/// Largest shift that a block measures, px. For a larger shift, the linearisation is wrong.
const MAX_SHIFT: f64 = 1.6;
/// Smallest gain of a valid measurement. With a smaller gain, the picture has lost the block's structure.
const MIN_GAIN: f64 = 0.08;
/// Largest rate at which the background follows the pictures, grey levels per second. At this rate, the background is
/// about the median of the pictures over most of a minute.
const FOLLOW: f64 = 2.0;
/// Interval at which gradients and blocks are recomputed, s.
const REFRESH_S: f64 = 2.0;

/// A square of the background with enough structure to measure a shift.
#[derive(Clone, Debug)]
struct Block {
    x: usize,
    y: usize,
    inverse: Matrix4<f64>,
    /// Smaller eigenvalue of the mean of ∇R ∇Rᵀ over the block, (grey levels per px)²; ∇R is the gradient.
    structure: f64,
    /// Running share of pictures in which the block measured a shift, 0–1.
    trust: f64,
}

/// The shift that one block measured in one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BlockShift {
    /// Position of the block's centre relative to the picture's middle, px.
    pub centre: Vector2<f64>,
    /// Shift of the picture in this block, px; `None` if the picture does not match the block.
    pub shift: Option<Vector2<f64>>,
    /// Whether the block measured a shift in enough of the pictures so far.
    pub is_trusted: bool,
}

/// A picture prepared for the alignment with a background: its grey values, raw and smoothed.
#[derive(Clone, Debug)]
pub(crate) struct Smoothed {
    width: usize,
    height: usize,
    values: Vec<f32>,
    smooth: Vec<f32>,
}

impl Smoothed {
    pub(crate) fn of(picture: &SmallGrey) -> Self {
        let values: Vec<f32> = picture.values.iter().map(|v| f32::from(*v)).collect();
        let smooth = smoothed(&values, picture.width, picture.height);
        Self { width: picture.width, height: picture.height, values, smooth }
    }

    /// Returns the smoothed grey values, row by row. Blocks are compared with these values.
    pub(crate) fn smooth(&self) -> &[f32] {
        &self.smooth
    }

    /// Returns the picture as it would lie on `level`, by bilinear interpolation. Where the level is not in view, the
    /// result has its values. `mapping` maps the level to this picture, px from the middle.
    pub(crate) fn laid_on(&self, level: &Level, mapping: &PictureMotion) -> Self {
        let middle = Vector2::new(self.width as f64, self.height as f64) / 2.0;
        let from = |point: Vector2<f64>| mapping.apply(&(point - middle)) + middle;
        let values = resampled(&self.values, (self.width, self.height), from, |pixel| level.median[pixel]);
        let smooth = smoothed(&values, self.width, self.height);
        Self { width: self.width, height: self.height, values, smooth }
    }
}

/// A picture of the place, at one size. It adapts to later pictures.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    width: usize,
    height: usize,
    /// Running median of the pictures, grey levels.
    median: Vec<f32>,
    /// The smoothed `median`, with which pictures are compared.
    smooth: Vec<f32>,
    gradient_x: Vec<f32>,
    gradient_y: Vec<f32>,
    blocks: Vec<Block>,
    followed_s: Option<f64>,
    refreshed_s: f64,
}

impl Level {
    /// Creates the background from the first picture.
    pub(crate) fn new(picture: &Smoothed) -> Self {
        let mut level = Self {
            width: picture.width,
            height: picture.height,
            median: picture.values.clone(),
            smooth: Vec::new(),
            gradient_x: Vec::new(),
            gradient_y: Vec::new(),
            blocks: Vec::new(),
            followed_s: None,
            refreshed_s: f64::NEG_INFINITY,
        };
        level.refresh();
        level.blocks.iter_mut().for_each(|block| block.trust = 1.0);
        level
    }

    /// Returns the number of trusted blocks.
    pub(crate) fn block_count(&self) -> usize {
        self.blocks.iter().filter(|block| block.trust >= TRUSTED).count()
    }

    /// Whether each field of a 3 × 3 grid over the picture has enough trusted blocks.
    pub(crate) fn is_structured_all_over(&self) -> bool {
        let ninth = |block: &Block| 3 * block.x / self.width.max(1) + 3 * (3 * block.y / self.height.max(1));
        let mut counts = [0; 9];
        self.blocks.iter().filter(|block| block.trust >= TRUSTED).for_each(|block| counts[ninth(block)] += 1);
        counts.iter().all(|count| *count >= MIN_IN_NINTH)
    }

    pub(crate) fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Returns the grey values of the smoothed background, row by row.
    pub(crate) fn values(&self) -> &[f32] {
        &self.smooth
    }

    /// Returns the top-left corners of the trusted blocks with the most structure, best first. There are at most
    /// `count` of them.
    pub(crate) fn best_blocks(&self, count: usize) -> Vec<(usize, usize)> {
        let trusted = self.blocks.iter().filter(|block| block.trust >= TRUSTED);
        trusted.take(count).map(|block| (block.x, block.y)).collect()
    }

    /// Adapts the background slightly to a picture of the camera at rest. `shifts` is the result of [`Self::measured`]
    /// for this picture.
    pub(crate) fn follow(&mut self, picture: &Smoothed, shifts: &[BlockShift], time_s: f64) {
        let seconds = self.followed_s.map_or(0.0, |last| (time_s - last).clamp(0.0, 1.0));
        self.followed_s = Some(time_s);
        let step = (FOLLOW * seconds) as f32;
        for (median, value) in self.median.iter_mut().zip(&picture.values) {
            *median += (*value - *median).clamp(-step, step);
        }
        let share = 1.0 - (-seconds / TRUST_S).exp();
        for (block, measured) in self.blocks.iter_mut().zip(shifts) {
            block.trust += share * (f64::from(u8::from(measured.shift.is_some())) - block.trust);
        }
        if time_s - self.refreshed_s >= REFRESH_S {
            self.refreshed_s = time_s;
            self.refresh();
        }
    }

    /// Measures the shift of every block in a smoothed picture. `base` is the approximate shift of the whole picture,
    /// px.
    pub(crate) fn measured(&self, picture: &[f32], base: [i64; 2]) -> Vec<BlockShift> {
        let middle = Vector2::new(self.width as f64 / 2.0, self.height as f64 / 2.0);
        let half = BLOCK as f64 / 2.0;
        let shifted = |at: usize, by: i64, length: usize| {
            let at = usize::try_from(at as i64 + by).ok()?;
            (at + BLOCK <= length).then_some(at)
        };
        let shift = |block: &Block| {
            let (x, y) = (shifted(block.x, base[0], self.width)?, shifted(block.y, base[1], self.height)?);
            Some(self.shift(block, picture, (x, y))? + Vector2::new(base[0] as f64, base[1] as f64))
        };
        self.blocks
            .iter()
            .map(|block| BlockShift {
                centre: Vector2::new(block.x as f64 + half, block.y as f64 + half) - middle,
                shift: shift(block),
                is_trusted: block.trust >= TRUSTED,
            })
            .collect()
    }

    /// Measures the shift between a block and the picture's square with its corner at (x, y). Returns `None` if they do
    /// not match.
    fn shift(&self, block: &Block, picture: &[f32], (x, y): (usize, usize)) -> Option<Vector2<f64>> {
        let mut right = [0.0_f32; 4];
        let mut squares = 0.0_f32;
        for line in 0..BLOCK {
            let own = (block.y + line) * self.width + block.x;
            let other = (y + line) * self.width + x;
            let (reference, values) = (&self.smooth[own..own + BLOCK], &picture[other..other + BLOCK]);
            let (gx, gy) = (&self.gradient_x[own..own + BLOCK], &self.gradient_y[own..own + BLOCK]);
            for i in 0..BLOCK {
                let value = values[i];
                right[0] += reference[i] * value;
                right[1] += value;
                right[2] -= gx[i] * value;
                right[3] -= gy[i] * value;
                squares += value * value;
            }
        }
        let right = Vector4::from(right.map(f64::from));
        let solution = block.inverse * right;
        let count = (BLOCK * BLOCK) as f64;
        let variance = f64::from(squares) - right[1] * right[1] / count;
        let unexplained = f64::from(squares) - solution.dot(&right);
        let gain = solution[0];
        if gain < MIN_GAIN || unexplained > (1.0 - MIN_EXPLAINED) * variance {
            return None;
        }
        let shift = Vector2::new(solution[2], solution[3]) / gain;
        (shift.norm() < MAX_SHIFT).then_some(shift)
    }

    fn refresh(&mut self) {
        let (width, height) = (self.width, self.height);
        self.smooth = smoothed(&self.median, width, height);
        let at = |x: usize, y: usize| self.smooth[y * width + x];
        self.gradient_x = vec![0.0; width * height];
        self.gradient_y = vec![0.0; width * height];
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                self.gradient_x[y * width + x] = 0.5 * (at(x + 1, y) - at(x - 1, y));
                self.gradient_y[y * width + x] = 0.5 * (at(x, y + 1) - at(x, y - 1));
            }
        }
        let starts = |length: usize| (BLOCK / 2..length.saturating_sub(BLOCK)).step_by(BLOCK);
        let former = std::mem::take(&mut self.blocks);
        let mut blocks: Vec<Block> = starts(height)
            .flat_map(|y| starts(width).map(move |x| (x, y)))
            .filter_map(|(x, y)| self.block(x, y))
            .collect();
        blocks.sort_by(|a, b| b.structure.total_cmp(&a.structure).then((a.y, a.x).cmp(&(b.y, b.x))));
        for block in &mut blocks {
            let before = former.iter().find(|k| (k.x, k.y) == (block.x, block.y));
            block.trust = before.map_or(NEW_TRUST, |k| k.trust);
        }
        self.blocks = blocks;
    }

    fn block(&self, x: usize, y: usize) -> Option<Block> {
        let mut normal = [[0.0_f32; 4]; 4];
        for row in y..y + BLOCK {
            for i in row * self.width + x..row * self.width + x + BLOCK {
                let basis = [self.smooth[i], 1.0, -self.gradient_x[i], -self.gradient_y[i]];
                for (sums, a) in normal.iter_mut().zip(basis) {
                    for (sum, b) in sums.iter_mut().zip(basis) {
                        *sum += a * b;
                    }
                }
            }
        }
        let normal = Matrix4::from_fn(|r, c| f64::from(normal[r][c]));
        let count = (BLOCK * BLOCK) as f64;
        let (xx, xy, yy) = (normal[(2, 2)] / count, normal[(2, 3)] / count, normal[(3, 3)] / count);
        let structure = (xx + yy) / 2.0 - ((xx - yy) / 2.0).hypot(xy);
        if structure < MIN_STRUCTURE {
            return None;
        }
        let inverse = normal.cholesky()?.inverse();
        Some(Block { x, y, inverse, structure, trust: NEW_TRUST })
    }
}

/// Resamples a picture by bilinear interpolation. `from` maps the middle of a pixel of the result to the picture, px. It
/// is smooth: it is evaluated at every eighth pixel and interpolated between them. Where it is outside the picture,
/// `outside` returns the value of the pixel with this number.
pub(crate) fn resampled(
    picture: &[f32],
    (width, height): (usize, usize),
    from: impl Fn(Vector2<f64>) -> Vector2<f64>,
    outside: impl Fn(usize) -> f32,
) -> Vec<f32> {
    const STEP: usize = 8;
    let (last_x, last_y) = (width as f64 - 1.0, height as f64 - 1.0);
    let value = |pixel: usize, at: &Vector2<f64>| {
        if !(0.0..=last_x).contains(&at.x) || !(0.0..=last_y).contains(&at.y) {
            return outside(pixel);
        }
        let (column, row) = (at.x as usize, at.y as usize);
        let (u, v) = ((at.x - column as f64) as f32, (at.y - row as f64) as f32);
        let (right, below) = ((column + 1).min(width - 1), (row + 1).min(height - 1));
        let mix = |row: usize| picture[row * width + column] * (1.0 - u) + picture[row * width + right] * u;
        mix(row) * (1.0 - v) + mix(below) * v
    };
    let knots = |row: usize| -> Vec<Vector2<f64>> {
        let knot = |column: usize| Vector2::new((STEP * column) as f64, (STEP * row) as f64);
        let middle = |column| from(knot(column).add_scalar(0.5)).add_scalar(-0.5);
        (0..=width.div_ceil(STEP)).map(middle).collect()
    };
    let mut out = Vec::with_capacity(width * height);
    let (mut upper, mut lower) = (knots(0), knots(1));
    for y in 0..height {
        if y > 0 && y % STEP == 0 {
            upper = lower;
            lower = knots(y / STEP + 1);
        }
        let share = (y % STEP) as f64 / STEP as f64;
        let mut left = upper[0] + (lower[0] - upper[0]) * share;
        for (column, (above, below)) in upper.iter().zip(&lower).enumerate().skip(1) {
            let right = above + (below - above) * share;
            let step = (right - left) / STEP as f64;
            for x in STEP * (column - 1)..(STEP * column).min(width) {
                let at = left + step * (x % STEP) as f64;
                out.push(value(y * width + x, &at));
            }
            left = right;
        }
    }
    out
}

/// Smooths a picture with a binomial 3 × 3 kernel. In the result, grey levels change nearly
/// linearly over a pixel, so that shifts below a pixel can be measured. Border pixels keep their values in the direction
/// of the missing neighbour.
fn smoothed(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let mut across = values.to_vec();
    // A reduced picture may have no column.
    let row = width.max(1);
    for (out, row) in across.chunks_exact_mut(row).zip(values.chunks_exact(row)) {
        for (out, three) in out[1..].iter_mut().zip(row.windows(3)) {
            *out = 0.25 * three[0] + 0.5 * three[1] + 0.25 * three[2];
        }
    }
    let mut out = across.clone();
    for y in 1..height.saturating_sub(1) {
        let (above, here, below) =
            (&across[(y - 1) * width..], &across[y * width..], &across[(y + 1) * width..]);
        for (x, out) in out[y * width..(y + 1) * width].iter_mut().enumerate() {
            *out = 0.25 * above[x] + 0.5 * here[x] + 0.25 * below[x];
        }
    }
    out
}
