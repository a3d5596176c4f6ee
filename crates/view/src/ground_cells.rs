//! The part of the ground on which drawings show a grid.

use std::collections::BTreeSet;

/// Distance between the lines of the grid, m.
const GRID_M: f64 = 5.0;
/// Largest distance of a grid cell from the camera, m.
const REACH_M: f64 = 300.0;

/// A set of square cells on the ground. A cell is stored as its corner with the smallest x and y, in units of the grid
/// spacing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GroundCells(BTreeSet<(i32, i32)>);

impl GroundCells {
    /// Adds the cell that contains a position (world x and y, m) and the eight cells around that cell.
    ///
    /// A position more than 300 m from the camera is ignored.
    pub fn add(&mut self, x_m: f64, y_m: f64) {
        if x_m.hypot(y_m) > REACH_M {
            return;
        }
        let cell = |v: f64| (v / GRID_M).floor() as i32;
        let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (i, j)));
        self.0.extend(around.map(|(i, j)| (cell(x_m) + i, cell(y_m) + j)));
    }

    /// Returns the edges of all cells. Each edge is a pair of ends in world x and y, m. An edge that two cells share is
    /// returned once.
    pub(crate) fn edges(&self) -> Vec<[[f64; 2]; 2]> {
        let around = |&(i, j): &(i32, i32)| {
            let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            [
                (corners[0], corners[1]),
                (corners[0], corners[3]),
                (corners[1], corners[2]),
                (corners[3], corners[2]),
            ]
        };
        let edges: BTreeSet<_> = self.0.iter().flat_map(around).collect();
        let at = |(i, j): (i32, i32)| [i, j].map(|v| f64::from(v) * GRID_M);
        edges.into_iter().map(|(from, to)| [at(from), at(to)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_cells_share_their_edges() {
        let mut cells = GroundCells::default();
        cells.add(2.0, 12.0);
        assert_eq!(cells.edges().len(), 24, "three by three squares");
        cells.add(1.0, 13.0);
        assert_eq!(cells.edges().len(), 24);
        cells.add(7.0, 12.0);
        assert_eq!(cells.edges().len(), 31);
        cells.add(0.0, 4000.0);
        assert_eq!(cells.edges().len(), 31);
    }
}
