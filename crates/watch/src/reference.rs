//! A picture of the place, at two sizes. The half-size copy can measure shifts twice as large as the
//! full-size copy can. The full-size copy then refines these shifts.

use crate::SmallGrey;
use crate::alignment::Alignment;
use crate::level::{BlockShift, Level, Smoothed};

/// A picture at two sizes, prepared for the alignment with a [`Reference`].
#[derive(Debug)]
pub(crate) struct Prepared {
    fine: Smoothed,
    coarse: Smoothed,
}

impl Prepared {
    pub(crate) fn of(picture: &SmallGrey) -> Self {
        Self { fine: Smoothed::of(picture), coarse: Smoothed::of(&picture.halved()) }
    }

    /// Returns the smoothed grey values at the finer size, row by row.
    pub(crate) fn smooth(&self) -> &[f32] {
        self.fine.smooth()
    }

    /// Returns the picture at the finer size.
    pub(crate) fn fine(&self) -> &Smoothed {
        &self.fine
    }

    /// Returns the picture at half that size.
    pub(crate) fn coarse(&self) -> &Smoothed {
        &self.coarse
    }
}

/// The shifts that the blocks of a [`Reference`] measured in one picture.
#[derive(Debug)]
pub(crate) struct BlockShifts {
    pub fine: Vec<BlockShift>,
    pub coarse: Vec<BlockShift>,
}

/// A picture of the place, at two sizes. It adapts to later pictures.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    fine: Level,
    coarse: Level,
}

impl Reference {
    /// Creates the background from the first picture.
    pub(crate) fn new(picture: &Prepared) -> Self {
        Self { fine: Level::new(&picture.fine), coarse: Level::new(&picture.coarse) }
    }

    /// Returns the background at the finer size. Results are given in px of this size.
    pub(crate) fn fine(&self) -> &Level {
        &self.fine
    }

    /// Returns the background at half that size.
    pub(crate) fn coarse(&self) -> &Level {
        &self.coarse
    }

    /// Measures the shift of each block of the background in a picture.
    pub(crate) fn measured(&self, picture: &Prepared) -> BlockShifts {
        let coarse = self.coarse.measured(picture.coarse.smooth(), [0, 0]);
        let base = Alignment::of(&coarse).map_or([0, 0], |alignment| {
            let shift = 2.0 * alignment.shift;
            [shift.x, shift.y].map(|v| v.round() as i64)
        });
        BlockShifts { fine: self.fine.measured(picture.fine.smooth(), base), coarse }
    }

    /// Adapts the background slightly to a picture that was laid on it, at both sizes. `shifts` was measured in this
    /// picture.
    pub(crate) fn follow(&mut self, [fine, coarse]: [&Smoothed; 2], shifts: &BlockShifts, time_s: f64) {
        self.fine.follow(fine, &shifts.fine, time_s);
        self.coarse.follow(coarse, &shifts.coarse, time_s);
    }
}
