//! Fits one homography of the whole picture to the measured shifts of its blocks.

use nalgebra::{SMatrix, SVector, Vector2};
use roadplane_base::Homography;

use crate::alignment::Alignment;
use crate::level::{BLOCK, BlockShift, Level, Smoothed};
use crate::reference::{BlockShifts, Prepared, Reference};

/// Sd of the shift that a block measures, px of the reduced picture. Measured on clips that `make_motion.py` turned: the
/// median deviation of agreeing blocks is 0.08 px.
const BLOCK_SD: f64 = 0.12;
/// Largest difference between the measured position of an agreeing block and the fitted one, px of the reduced picture.
const AGREES: f64 = 0.5;
/// Displacement up to which a picture is not laid on its reference before the blocks are measured, px of the reduced
/// picture. Interpolation would cost more than it gains.
const NOT_LAID: f64 = 0.6;
/// Number of reweighted least-squares rounds.
const ROUNDS: usize = 5;
/// Largest sd of a mapped pixel, px of the reduced picture. A worse fit is no registration.
const MAX_SD: f64 = 0.5;
/// Sds of the change of a homography's numbers from one picture to the next. Lengths are in half widths of the picture.
/// The shift is free. The other values let a camera turn by a fifth of its field of view between two pictures.
const CHANGE_SD: [f64; 8] = [0.1, 0.1, 3.0, 0.1, 0.1, 3.0, 0.1, 0.1];

/// How a picture lies on a reference.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fit {
    /// Mapping from the reference to the picture, px of the reduced picture from its middle.
    pub picture_from_reference: Homography,
    /// Sd of a mapped pixel, px of the reduced picture: root mean square over the part of the reference in view.
    pub sd: f64,
}

impl Fit {
    /// The fit of a picture on itself.
    pub(crate) const OWN: Self = Self { picture_from_reference: Homography::IDENTITY, sd: 0.0 };
}

/// A picture that was registered on a reference.
#[derive(Debug)]
pub(crate) struct Registered {
    pub fit: Fit,
    /// Measured shifts of the blocks, in the picture laid on the reference.
    pub shifts: BlockShifts,
    /// The picture laid on the reference by a mapping near that of the fit, at both sizes. `None` if the picture is not
    /// displaced.
    pub laid: Option<[Smoothed; 2]>,
}

impl Reference {
    /// Registers a picture on this reference. `predicted` is about the mapping from the reference to the picture, within
    /// 3 px.
    pub(crate) fn registered(&self, picture: &Prepared, predicted: &Homography) -> Option<Registered> {
        let size = self.fine().size();
        let is_displaced = predicted.displacement(&picture_box(size)) > NOT_LAID;
        let predicted = if is_displaced { *predicted } else { Homography::IDENTITY };
        let half = predicted.in_coordinates(0.5, Vector2::zeros());
        let coarse_laid = is_displaced.then(|| picture.coarse().laid_on(self.coarse(), &half));
        let coarse = measured(self.coarse(), coarse_laid.as_ref().unwrap_or(picture.coarse()), &half);
        let mapping = match Alignment::of(&coarse) {
            Some(rest) if is_displaced || rest.displacement(size.0 / 2, size.1 / 2) > NOT_LAID => {
                corrected(&half, &rest, self.coarse())?.in_coordinates(2.0, Vector2::zeros())
            }
            _ => predicted,
        };
        let is_displaced = mapping != Homography::IDENTITY;
        let fine_laid = is_displaced.then(|| picture.fine().laid_on(self.fine(), &mapping));
        let fine = measured(self.fine(), fine_laid.as_ref().unwrap_or(picture.fine()), &mapping);
        let start = corrected(&mapping, &Alignment::of(&fine)?, self.fine())?;
        let fit = refined(&start, &mapping, &fine, size)?;
        let coarse_laid = coarse_laid.unwrap_or_else(|| picture.coarse().clone());
        let laid = fine_laid.map(|fine| [fine, coarse_laid]);
        Some(Registered { fit, shifts: BlockShifts { fine, coarse }, laid })
    }
}

/// Measures the shifts of the blocks in a picture that was laid on the level by `mapping`. Blocks that are not in view
/// have no shift.
fn measured(level: &Level, laid: &Smoothed, mapping: &Homography) -> Vec<BlockShift> {
    let mut blocks = level.measured(laid.smooth(), [0, 0]);
    if *mapping != Homography::IDENTITY {
        let [_, _, right, bottom] = picture_box(level.size());
        let half = BLOCK as f64 / 2.0 + 1.0;
        let is_in_view = |block: &BlockShift| {
            [(-half, -half), (half, -half), (-half, half), (half, half)].iter().all(|(x, y)| {
                let at = mapping.apply(&(block.centre + Vector2::new(*x, *y)));
                at.x.abs() < right && at.y.abs() < bottom
            })
        };
        blocks.iter_mut().filter(|block| !is_in_view(block)).for_each(|block| block.shift = None);
    }
    blocks
}

/// Returns the picture as a box, px of the reduced picture from its middle.
pub(crate) fn picture_box((width, height): (usize, usize)) -> [f64; 4] {
    let (x, y) = (width as f64 / 2.0, height as f64 / 2.0);
    [-x, -y, x, y]
}

/// Returns a mapping with a small alignment added.
fn corrected(mapping: &Homography, rest: &Alignment, level: &Level) -> Option<Homography> {
    let (width, height) = level.size();
    let reach = Vector2::new(width as f64, height as f64) / 2.0;
    let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(u, v)| {
        let p = Vector2::new(u * reach.x, v * reach.y);
        (p / reach.x, mapping.apply(&(p + rest.at(&p))) / reach.x, 1.0)
    });
    let (fitted, _) = Homography::fit(corners.into_iter(), None)?;
    Some(fitted.in_coordinates(reach.x, Vector2::zeros()))
}

/// Fits all eight numbers of a homography to the blocks, from a start that is right within a pixel. The blocks were
/// measured in a picture that was laid on the reference by `laid_by`.
fn refined(
    start: &Homography,
    laid_by: &Homography,
    blocks: &[BlockShift],
    (width, height): (usize, usize),
) -> Option<Fit> {
    let unit = width as f64 / 2.0;
    let measured: Vec<(Vector2<f64>, Vector2<f64>)> = blocks
        .iter()
        .filter(|block| block.is_trusted)
        .filter_map(|block| Some((block.centre / unit, laid_by.apply(&(block.centre + block.shift?)) / unit)))
        .collect();
    let prior = start.in_coordinates(1.0 / unit, Vector2::zeros());
    let information = SVector::from(CHANGE_SD.map(|sd| (sd * sd).recip()));
    let weight_of_block = (unit / BLOCK_SD).powi(2);
    let (mut mapping, mut covariance) = (prior, SMatrix::<f64, 8, 8>::identity());
    let mut reach = 2.0 * AGREES / unit;
    for _ in 0..ROUNDS {
        let weighted = measured.iter().filter_map(|(p, q)| {
            let away = (mapping.apply(p) - q).norm();
            (away < reach).then(|| (*p, *q, weight_of_block * (1.0 - (away / reach).powi(2)).powi(2)))
        });
        (mapping, covariance) = Homography::fit(weighted, Some((&prior, &information)))?;
        reach = (reach * 0.8).max(AGREES / unit);
    }
    let aspect = height as f64 / width as f64;
    let inverse = mapping.inverse();
    let is_in_view = |p: &Vector2<f64>| p.x.abs() <= 1.0 && p.y.abs() <= aspect;
    let variances: Vec<f64> = (0..25)
        .map(|i| Vector2::new(f64::from(i % 5) / 2.0 - 1.0, aspect * (f64::from(i / 5) / 2.0 - 1.0)))
        .map(|q| inverse.apply(&q))
        .filter(is_in_view)
        .map(|p| {
            let derivative = mapping.derivative_by_numbers(&p);
            (derivative * covariance * derivative.transpose()).trace() / 2.0
        })
        .collect();
    let sd = unit * (variances.iter().sum::<f64>() / variances.len().max(1) as f64).sqrt();
    let fit = Fit { picture_from_reference: mapping.in_coordinates(unit, Vector2::zeros()), sd };
    (!variances.is_empty() && sd <= MAX_SD).then_some(fit)
}
