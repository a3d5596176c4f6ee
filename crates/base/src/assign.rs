//! Minimum-cost assignment of rows to columns, where a row may stay unassigned at a fixed cost.

use pathfinding::{kuhn_munkres::kuhn_munkres_min, matrix::Matrix};

/// Step to which costs are rounded. Without it, floating-point errors of sums could change the result.
const STEP: f64 = 1e-6;

/// Returns a column or `None` for each row. The sum of all costs is the smallest possible.
///
/// An unassigned row costs `alone`. A row gets no column whose cost is infinite, NaN or not below `alone`.
/// `cost(row, column)` and `alone` should be of the order of 1.
#[must_use]
pub fn assign(
    rows: usize,
    columns: usize,
    alone: f64,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<Option<usize>> {
    if rows == 0 || columns == 0 {
        return vec![None; rows];
    }
    let price = |value: f64| (value.clamp(-1e9, 1e9) / STEP).round() as i64;
    // One additional column per row means that the row stays unassigned. A forbidden pair costs more than if all rows
    // stay unassigned.
    let forbidden = price(alone).saturating_add(1).saturating_mul(rows as i64 + 1);
    let costs = Matrix::from_fn(rows, columns + rows, |(row, column)| {
        let value = if column < columns { cost(row, column) } else { alone };
        if column >= columns || value < alone { price(value) } else { forbidden }
    });
    let (_, column_of) = kuhn_munkres_min(&costs);
    let allowed = |row: usize, column: usize| column < columns && cost(row, column) < alone;
    column_of.iter().enumerate().map(|(row, &column)| allowed(row, column).then_some(column)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns the smallest total cost, found by trying all assignments.
    fn exhaustive(row: usize, used: &mut Vec<bool>, alone: f64, costs: &[Vec<f64>]) -> f64 {
        let Some(own) = costs.get(row) else { return 0.0 };
        let mut best = alone + exhaustive(row + 1, used, alone, costs);
        for (column, &value) in own.iter().enumerate() {
            if !used[column] && value < alone {
                used[column] = true;
                best = best.min(value + exhaustive(row + 1, used, alone, costs));
                used[column] = false;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn no_other_pairing_is_cheaper(
            costs in (1usize..5, 1usize..5)
                .prop_flat_map(|(r, c)| prop::collection::vec(prop::collection::vec(0.0f64..1.5, c), r)),
        ) {
            let (rows, columns) = (costs.len(), costs[0].len());
            let pairs = assign(rows, columns, 1.0, |r, c| costs[r][c]);
            let total: f64 = pairs.iter().enumerate().map(|(r, c)| c.map_or(1.0, |c| costs[r][c])).sum();
            let least = exhaustive(0, &mut vec![false; columns], 1.0, &costs);
            prop_assert!((total - least).abs() < 1e-4, "{total} against {least}");
            let mut taken: Vec<usize> = pairs.iter().flatten().copied().collect();
            taken.sort_unstable();
            taken.dedup();
            prop_assert_eq!(taken.len(), pairs.iter().flatten().count());
        }
    }

    #[test]
    fn impossible_pairs_are_not_made() {
        assert_eq!(assign(2, 1, 1.0, |_, _| f64::NAN), [None, None]);
        assert_eq!(assign(1, 2, 1.0, |_, c| if c == 0 { f64::INFINITY } else { 0.5 }), [Some(1)]);
        assert_eq!(assign(0, 3, 1.0, |_, _| 0.0), Vec::<Option<usize>>::new());
        assert_eq!(assign(2, 0, 1.0, |_, _| 0.0), [None, None]);
    }
}
