//! The background at rest at two sizes: the halved one measures shifts twice as large, the full one refines them.

use crate::SmallGrey;
use crate::alignment::Alignment;
use crate::level::{BlockShift, Level, Smoothed};

/// A picture prepared for the alignment with references.
#[derive(Debug)]
pub(crate) struct Prepared {
    fine: Smoothed,
    coarse: Smoothed,
}

impl Prepared {
    pub(crate) fn of(picture: &SmallGrey) -> Self {
        Self { fine: Smoothed::of(picture), coarse: Smoothed::of(&picture.halved()) }
    }

    /// Returns the smoothed picture at the finer size.
    pub(crate) fn smooth(&self) -> &[f32] {
        self.fine.smooth()
    }
}

/// The shifts that a reference's blocks measured in a picture.
#[derive(Debug)]
pub(crate) struct BlockShifts {
    pub fine: Vec<BlockShift>,
    coarse: Vec<BlockShift>,
}

/// The background at rest at both sizes.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    fine: Level,
    coarse: Level,
}

impl Reference {
    /// Starts from the first picture.
    pub(crate) fn new(picture: &Prepared) -> Self {
        Self { fine: Level::new(&picture.fine), coarse: Level::new(&picture.coarse) }
    }

    /// Returns the finer level, at which results are reported.
    pub(crate) fn fine(&self) -> &Level {
        &self.fine
    }

    /// Measures the shift of each block in a picture.
    pub(crate) fn measured(&self, picture: &Prepared) -> BlockShifts {
        let coarse = self.coarse.measured(picture.coarse.smooth(), [0, 0]);
        let base = Alignment::of(&coarse).map_or([0, 0], |alignment| {
            let shift = 2.0 * alignment.shift;
            [shift.x, shift.y].map(|v| v.round() as i64)
        });
        BlockShifts { fine: self.fine.measured(picture.fine.smooth(), base), coarse }
    }

    /// Moves the background a little towards a picture at rest; `shifts` are its measurements from [`Self::measured`].
    pub(crate) fn follow(&mut self, picture: &Prepared, shifts: &BlockShifts, time_s: f64) {
        self.fine.follow(&picture.fine, &shifts.fine, time_s);
        self.coarse.follow(&picture.coarse, &shifts.coarse, time_s);
    }
}
