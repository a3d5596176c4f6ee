//! Fits one homography of the whole picture, and the lens distortion, to the measured shifts of its blocks.

use nalgebra::{SMatrix, SVector, Vector2};
use roadplane_base::{Homography, Lens, PictureMotion};

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
/// Largest number of times that a picture is laid on its reference.
const MOST_LAID: usize = 3;
/// Change of a fit below which the picture is not laid on the reference again, px of the reduced picture.
const SETTLED: f64 = 0.1;

/// Prior sd of the distortion at half the picture's width (dimensionless). Surveillance lenses reach −0.3.
const DISTORTION_SD: f64 = 0.15;
/// Least prior sd of the distortion (dimensionless). Pictures of one reference share its error, so their mean is less
/// accurate than the sum of their information says.
const LEAST_DISTORTION_SD: f64 = 0.005;
/// Largest absolute distortion of a fit. Beyond it, a corner of a picture of 4:3 is at infinity.
const MOST_DISTORTION: f64 = 0.5;

/// How a picture lies on a reference.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fit {
    /// Mapping from the reference to the picture, px of the reduced picture from its middle.
    pub picture_from_reference: PictureMotion,
    /// Sd of a mapped pixel for a known lens, px of the reduced picture: root mean square over the part of the reference
    /// in view.
    pub sd: f64,
    /// Distortion at half the picture's width that the blocks show without the prior, and its sd (dimensionless).
    pub lens: [f64; 2],
    /// Derivatives of the homography's numbers by the distortion. Lengths are in half widths of the picture.
    pub change: [f64; 8],
}

impl Fit {
    /// The fit of a picture on itself.
    pub(crate) const OWN: Self = Self {
        picture_from_reference: PictureMotion::IDENTITY,
        sd: 0.0,
        lens: [0.0, DISTORTION_SD],
        change: [0.0; 8],
    };
}

/// The mean distortion that earlier pictures show. Without it, vehicles that move alike would look like distortion.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LensMean {
    /// Sum of the inverse variances of the distortions, and the weighted sum of the distortions.
    information: f64,
    weighted: f64,
}

impl LensMean {
    pub(crate) fn add(&mut self, fit: &Fit) {
        let [distortion, sd] = fit.lens;
        self.information += sd.powi(-2);
        self.weighted += distortion * sd.powi(-2);
    }

    /// Returns the prior of the distortion: its mean and its information.
    fn prior(&self) -> [f64; 2] {
        let information = self.information + DISTORTION_SD.powi(-2);
        [self.weighted / information, information.min(LEAST_DISTORTION_SD.powi(-2))]
    }
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
    pub(crate) fn registered(
        &self,
        picture: &Prepared,
        predicted: &PictureMotion,
        lens: &LensMean,
    ) -> Option<Registered> {
        let size = self.fine().size();
        let is_displaced = predicted.homography.displacement(&picture_box(size)) > NOT_LAID;
        let predicted = if is_displaced { *predicted } else { PictureMotion::IDENTITY };
        let near = self.iterated(picture, &predicted, lens);
        let half = predicted.in_scale(0.5);
        let coarse_laid = is_displaced.then(|| picture.coarse().laid_on(self.coarse(), &half));
        let coarse = measured(self.coarse(), coarse_laid.as_ref().unwrap_or(picture.coarse()), &half);
        // The smaller pictures measure larger shifts, but with fewer blocks, so they may be wrong. The fit with which more
        // blocks agree is the better one.
        let far = Alignment::of(&coarse)
            .filter(|rest| is_displaced || rest.displacement(size.0 / 2, size.1 / 2) > NOT_LAID)
            .and_then(|rest| corrected(&half, &rest, self.coarse()))
            .and_then(|mapping| self.iterated(picture, &mapping.in_scale(2.0), lens));
        let best = match (near, far) {
            (Some(near), Some(far)) if far.agreement > near.agreement => far,
            (Some(near), _) => near,
            (None, far) => far?,
        };
        let coarse_laid = coarse_laid.unwrap_or_else(|| picture.coarse().clone());
        let laid = best.laid.map(|fine| [fine, coarse_laid]);
        Some(Registered { fit: best.fit, shifts: BlockShifts { fine: best.shifts, coarse }, laid })
    }

    /// Fits the blocks of a picture from a start. A block measures large shifts with a bias, so the picture is laid on the
    /// reference again by the fit.
    fn iterated(&self, picture: &Prepared, start: &PictureMotion, lens: &LensMean) -> Option<Fitted> {
        let mut best = self.fitted(picture, start, lens)?;
        let mut mapping = *start;
        let picture_px = picture_box(self.fine().size());
        for _ in 1..MOST_LAID {
            let next = best.fit.picture_from_reference;
            let change = mapping.homography.inverse().then(&next.homography);
            if change.displacement(&picture_px) < SETTLED
                || next.homography.displacement(&picture_px) < NOT_LAID
            {
                break;
            }
            mapping = next;
            match self.fitted(picture, &mapping, lens) {
                Some(next) if next.agreement >= best.agreement => best = next,
                _ => break,
            }
        }
        Some(best)
    }

    /// Lays a picture on this reference by a mapping, and fits the blocks.
    fn fitted(&self, picture: &Prepared, mapping: &PictureMotion, lens: &LensMean) -> Option<Fitted> {
        let laid = (!mapping.is_identity()).then(|| picture.fine().laid_on(self.fine(), mapping));
        let shifts = measured(self.fine(), laid.as_ref().unwrap_or(picture.fine()), mapping);
        let start = corrected(mapping, &Alignment::of(&shifts)?, self.fine())?;
        let (fit, agreement) = refined(&start, mapping, &shifts, self.fine().size(), lens.prior())?;
        Some(Fitted { fit, agreement, shifts, laid })
    }
}

/// A fit to the blocks of a picture that was laid on the reference.
struct Fitted {
    fit: Fit,
    /// Share of the trusted blocks in view that agree with the fit.
    agreement: f64,
    shifts: Vec<BlockShift>,
    laid: Option<Smoothed>,
}

/// Measures the shifts of the blocks in a picture that was laid on the level by `mapping`. Blocks that are not in view
/// have no shift.
fn measured(level: &Level, laid: &Smoothed, mapping: &PictureMotion) -> Vec<BlockShift> {
    let mut blocks = level.measured(laid.smooth(), [0, 0]);
    if !mapping.is_identity() {
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
fn corrected(mapping: &PictureMotion, rest: &Alignment, level: &Level) -> Option<PictureMotion> {
    let (width, height) = level.size();
    let reach = Vector2::new(width as f64, height as f64) / 2.0;
    let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(u, v)| {
        let p = Vector2::new(u * reach.x, v * reach.y);
        let q = mapping.apply(&(p + rest.at(&p)));
        (mapping.lens.undistorted(&p) / reach.x, mapping.lens.undistorted(&q) / reach.x, 1.0)
    });
    let (fitted, _) = Homography::fit(corners.into_iter(), None)?;
    Some(PictureMotion { homography: fitted.in_coordinates(reach.x, Vector2::zeros()), ..*mapping })
}

/// The eight numbers of a homography, then the distortion. Lengths are in half widths of the picture.
type Numbers = SVector<f64, 9>;

/// Returns the mapping with these numbers; `None` if the homography has no inverse.
fn motion_of(numbers: &Numbers) -> Option<PictureMotion> {
    let homography = Homography::from_numbers(numbers.fixed_rows::<8>(0).into_owned().into())?;
    let lens = Lens { per_px2: numbers[8].clamp(-MOST_DISTORTION, MOST_DISTORTION) };
    Some(PictureMotion { homography, lens, ..PictureMotion::IDENTITY })
}

/// Returns a mapped point and its derivative by the numbers.
fn mapped(motion: &PictureMotion, p: &Vector2<f64>) -> (Vector2<f64>, SMatrix<f64, 2, 9>) {
    let PictureMotion { homography, lens, .. } = motion;
    let straight = lens.undistorted(p);
    let q = lens.distorted(&homography.apply(&straight));
    let by_straight = lens.undistorted_by_pixel(&q).try_inverse().unwrap_or_else(nalgebra::Matrix2::identity);
    let mut derivative = SMatrix::<f64, 2, 9>::zeros();
    derivative.fixed_columns_mut::<8>(0).copy_from(&homography.derivative_by_numbers(&straight));
    let by_lens = homography.jacobian(&straight) * lens.undistorted_by_lens(p) - lens.undistorted_by_lens(&q);
    derivative.set_column(8, &by_lens);
    (q, by_straight * derivative)
}

/// Fits all numbers of a homography and the distortion to the blocks, from a start that is right within a pixel. The
/// blocks were measured in a picture that was laid on the reference by `laid_by`.
fn refined(
    start: &PictureMotion,
    laid_by: &PictureMotion,
    blocks: &[BlockShift],
    (width, height): (usize, usize),
    [distortion, of_distortion]: [f64; 2],
) -> Option<(Fit, f64)> {
    let unit = width as f64 / 2.0;
    let measured: Vec<(Vector2<f64>, Vector2<f64>)> = blocks
        .iter()
        .filter(|block| block.is_trusted)
        .filter_map(|block| Some((block.centre / unit, laid_by.apply(&(block.centre + block.shift?)) / unit)))
        .collect();
    let start = start.in_scale(1.0 / unit);
    let mut numbers = Numbers::zeros();
    numbers.fixed_rows_mut::<8>(0).copy_from_slice(&start.homography.numbers());
    let (mut prior, mut information) = (numbers, Numbers::zeros());
    numbers[8] = start.lens.per_px2;
    prior[8] = distortion;
    information.fixed_rows_mut::<8>(0).copy_from_slice(&CHANGE_SD.map(|sd| (sd * sd).recip()));
    information[8] = of_distortion;
    let weight_of_block = (unit / BLOCK_SD).powi(2);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    let mut reach = 2.0 * AGREES / unit;
    for _ in 0..ROUNDS {
        let motion = motion_of(&numbers)?;
        normal = SMatrix::from_diagonal(&information);
        let mut right = information.component_mul(&(prior - numbers));
        for (p, q) in &measured {
            let (here, derivative) = mapped(&motion, p);
            let away = q - here;
            if away.norm() < reach {
                let weight = weight_of_block * (1.0 - (away.norm() / reach).powi(2)).powi(2);
                normal += derivative.transpose() * derivative * weight;
                right += derivative.transpose() * away * weight;
            }
        }
        numbers += normal.cholesky()?.solve(&right);
        numbers[8] = numbers[8].clamp(-MOST_DISTORTION, MOST_DISTORTION);
        reach = (reach * 0.8).max(AGREES / unit);
    }
    let motion = motion_of(&numbers)?;
    let agreeing = measured.iter().filter(|(p, q)| (motion.apply(p) - q).norm() < AGREES / unit).count();
    let [_, _, right, bottom] = picture_box((width, height));
    let is_seen = |block: &&BlockShift| {
        let at = motion.apply(&(block.centre / unit)) * unit;
        at.x.abs() < right && at.y.abs() < bottom
    };
    let trusted = blocks.iter().filter(|block| block.is_trusted).filter(is_seen).count();
    let agreement = agreeing as f64 / trusted.max(1) as f64;
    // For a known lens, the covariance is the inverse of the homography's part of the normal matrix.
    let of_lens = normal.fixed_view::<8, 1>(0, 8).into_owned();
    let covariance = normal.fixed_view::<8, 8>(0, 0).into_owned().cholesky()?.inverse();
    let change = -(covariance * of_lens);
    // The blocks alone: the prior is taken out again.
    let with_prior = normal[(8, 8)] + of_lens.dot(&change);
    let shown = (with_prior - of_distortion).max(DISTORTION_SD.powi(-2));
    let lens = [(with_prior * numbers[8] - of_distortion * distortion) / shown, shown.sqrt().recip()];
    let aspect = height as f64 / width as f64;
    let inverse = motion.inverse();
    let is_in_view = |p: &Vector2<f64>| p.x.abs() <= 1.0 && p.y.abs() <= aspect;
    let variances: Vec<f64> = (0..25)
        .map(|i| Vector2::new(f64::from(i % 5) / 2.0 - 1.0, aspect * (f64::from(i / 5) / 2.0 - 1.0)))
        .map(|q| inverse.apply(&q))
        .filter(is_in_view)
        .map(|p| {
            let derivative = mapped(&motion, &p).1.fixed_columns::<8>(0).into_owned();
            (derivative * covariance * derivative.transpose()).trace() / 2.0
        })
        .collect();
    let sd = unit * (variances.iter().sum::<f64>() / variances.len().max(1) as f64).sqrt();
    let fit = Fit { picture_from_reference: motion.in_scale(unit), sd, lens, change: change.into() };
    (!variances.is_empty() && sd <= MAX_SD).then_some((fit, agreement))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_a_mapped_point_are_exact() {
        let numbers = Numbers::from([1.02, 0.01, 0.2, -0.02, 0.99, 0.03, 0.05, -0.02, -0.12]);
        let p = Vector2::new(-0.6, 0.4);
        let (_, derivative) = mapped(&motion_of(&numbers).unwrap(), &p);
        for i in 0..9 {
            let at = |by: f64| {
                let mut changed = numbers;
                changed[i] += by;
                motion_of(&changed).unwrap().apply(&p)
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((numeric - derivative.column(i)).norm() < 1e-6, "{i}");
        }
    }

    #[test]
    fn a_pan_shows_the_lens() {
        let (size, unit) = ((320, 180), 160.0);
        for bend in [0.0, -0.05, -0.2] {
            let numbers = Numbers::from([1.0, 0.004, 0.25, -0.004, 1.0, 0.01, -0.04, 0.0, bend]);
            let truth = motion_of(&numbers).unwrap().in_scale(unit);
            let noise = |k: f64| 0.2 * ((k * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0) - 0.1;
            let centres =
                (0..19 * 11).map(|i| Vector2::new(f64::from(i % 19 - 9), f64::from(i / 19 - 5)) * 16.0);
            let block = |(i, centre): (usize, Vector2<f64>)| {
                let noise = Vector2::new(noise(i as f64 + 0.3), noise(i as f64 + 500.7));
                let shift = truth.apply(&centre) - centre + noise;
                let is_in_view = (centre + shift).x.abs() < 150.0;
                BlockShift { centre, shift: is_in_view.then_some(shift), is_trusted: true }
            };
            let blocks: Vec<BlockShift> = centres.enumerate().map(block).collect();
            let start = Homography::from_numbers([1.0, 0.0, 0.25 * unit, 0.0, 1.0, 1.5, -0.04 / unit, 0.0]);
            let start = PictureMotion { lens: truth.lens, ..PictureMotion::from(start.unwrap()) };
            let prior = LensMean::default().prior();
            let (fit, _) = refined(&start, &PictureMotion::IDENTITY, &blocks, size, prior).unwrap();
            let [found, sd] = fit.lens;
            assert!((found - bend).abs() < 3.0 * sd && sd < 0.005, "{bend}: {found} {sd}");
            let away = |p: Vector2<f64>| (fit.picture_from_reference.apply(&p) - truth.apply(&p)).norm();
            assert!(away(Vector2::new(-140.0, 70.0)) < 0.15 && away(Vector2::zeros()) < 0.1);
        }
    }
}
