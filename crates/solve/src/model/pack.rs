//! Keypoints in the form that the inner loop reads: in packs of four, one keypoint per lane of a vector register.

use crate::linear::lanes::{LANES, Lanes};
use crate::model::observation::Observation;
use crate::model::points::PointModes;

/// Four keypoints of a view: their pixels, weights, and mean positions and modes from the shape atlas.
///
/// If the number of keypoints is not a multiple of four, copies with weight 0 fill the last pack.
#[derive(Clone, Debug)]
pub(crate) struct Pack<const M: usize> {
    pub pixel: [Lanes; 2],
    pub whitening: [Lanes; 3],
    pub weight: Lanes,
    pub mean: [Lanes; 3],
    pub modes: [[Lanes; 3]; M],
}

impl<const M: usize> Pack<M> {
    fn empty() -> Self {
        let none = Lanes::default();
        Self { pixel: [none; 2], whitening: [none; 3], weight: none, mean: [none; 3], modes: [[none; 3]; M] }
    }
}

/// Groups a view's keypoints into packs, one keypoint per SIMD lane, and appends the packs to `into`.
pub(crate) fn pack<const M: usize>(
    model: &PointModes<M>,
    observations: &[Observation],
    into: &mut Vec<Pack<M>>,
) {
    for four in observations.chunks(LANES) {
        let mut pack = Pack::empty();
        for lane in 0..LANES {
            let Some(o) = four.get(lane).or(four.last()) else { continue };
            for axis in 0..2 {
                pack.pixel[axis].0[lane] = o.pixel[axis];
            }
            for axis in 0..3 {
                pack.whitening[axis].0[lane] = o.whitening[axis];
                pack.mean[axis].0[lane] = model.mean[o.index][axis];
                for (j, mode) in model.modes[o.index].iter().enumerate() {
                    pack.modes[j][axis].0[lane] = mode[axis];
                }
            }
            pack.weight.0[lane] = if lane < four.len() { o.weight } else { 0.0 };
        }
        into.push(pack);
    }
}

/// Copies the whitening matrices of a view's keypoints into their packs.
pub(crate) fn rewhiten<const M: usize>(observations: &[Observation], packs: &mut [Pack<M>]) {
    for (four, pack) in observations.chunks(LANES).zip(packs) {
        for lane in 0..LANES {
            let whitening = four[lane.min(four.len() - 1)].whitening;
            for (lanes, value) in pack.whitening.iter_mut().zip(whitening) {
                lanes.0[lane] = value;
            }
        }
    }
}
