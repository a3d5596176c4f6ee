//! Minimises a cost by the method of Levenberg and Marquardt.

/// Largest number of rounds of an iterative solution.
pub(crate) const MAX_ROUNDS: usize = 40;
/// Least gain of a round, in units of the cost. A descent ends where a round gains less.
const LEAST_GAIN: f64 = 1e-4;

/// Minimises `cost`, a negative log posterior, from the unknowns `at` on. `linear` returns the normal equations there,
/// and `moved` the unknowns after the step with a damping. Returns `None` where the start has no cost, or where the
/// normal equations fail.
pub(crate) fn descend<U, N>(
    mut at: U,
    cost: impl Fn(&U) -> Option<f64>,
    linear: impl Fn(&U) -> Option<N>,
    moved: impl Fn(&U, &N, f64) -> Option<U>,
) -> Option<U> {
    let (mut lowest, mut damping) = (cost(&at)?, 1e-4);
    for _ in 0..MAX_ROUNDS {
        let normal = linear(&at)?;
        let lower = |damping: f64| {
            let to = moved(&at, &normal, damping)?;
            let reached = cost(&to).filter(|reached| *reached <= lowest)?;
            Some((to, reached))
        };
        let mut found = lower(damping);
        while found.is_none() && damping < 1e9 {
            damping *= 10.0;
            found = lower(damping);
        }
        let Some((to, reached)) = found else { break };
        let gain = lowest - reached;
        (at, lowest, damping) = (to, reached, (damping * 0.1).max(1e-9));
        if gain < LEAST_GAIN {
            break;
        }
    }
    Some(at)
}
