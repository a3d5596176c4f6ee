//! The background at rest at two sizes: halved, it tells shifts of twice as many pixels, which the other takes further.

use crate::SmallGrey;
use crate::alignment::Alignment;
use crate::level::{BlockShift, Level, Smoothed};

/// A picture made ready to be laid on references.
#[derive(Debug)]
pub(crate) struct Prepared {
    fine: Smoothed,
    coarse: Smoothed,
}

impl Prepared {
    pub(crate) fn of(picture: &SmallGrey) -> Self {
        Self { fine: Smoothed::of(picture), coarse: Smoothed::of(&picture.halved()) }
    }

    /// The picture smoothed.
    pub(crate) fn smooth(&self) -> &[f32] {
        self.fine.smooth()
    }
}

/// What a reference's blocks say of a picture.
#[derive(Debug)]
pub(crate) struct Told {
    pub fine: Vec<BlockShift>,
    coarse: Vec<BlockShift>,
}

/// The background at rest.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    fine: Level,
    coarse: Level,
}

impl Reference {
    /// From its first picture.
    pub(crate) fn new(picture: &Prepared) -> Self {
        Self { fine: Level::new(&picture.fine), coarse: Level::new(&picture.coarse) }
    }

    /// The level that results are told at.
    pub(crate) fn fine(&self) -> &Level {
        &self.fine
    }

    /// What each block says of a picture.
    pub(crate) fn told(&self, picture: &Prepared) -> Told {
        let coarse = self.coarse.told(picture.coarse.smooth(), [0, 0]);
        let base = Alignment::of(&coarse).map_or([0, 0], |alignment| {
            let shift = 2.0 * alignment.shift;
            [shift.x, shift.y].map(|v| v.round() as i64)
        });
        Told { fine: self.fine.told(picture.fine.smooth(), base), coarse }
    }

    /// Follows a picture a little, where the camera is at rest; `told` is what [`Self::told`] said of it.
    pub(crate) fn follow(&mut self, picture: &Prepared, told: &Told, time_s: f64) {
        self.fine.follow(&picture.fine, &told.fine, time_s);
        self.coarse.follow(&picture.coarse, &told.coarse, time_s);
    }
}
