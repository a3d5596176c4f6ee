//! The loop of the Levenberg–Marquardt method: damping and stopping rules. A [`Problem`] brings its own structure.

/// A least-squares problem for the loop. It owns its parameters, its linearisation and its trial step.
pub trait Problem {
    /// Computes residuals, Jacobians and normal equations at the current parameters.
    ///
    /// Returns the largest absolute entry of the scaled gradient (zero at a minimum), or `None` if the parameters
    /// cannot be evaluated.
    fn linearise(&mut self) -> Option<f64>;

    /// Returns the cost at the current parameters, as of their last linearisation.
    fn cost(&self) -> f64;

    /// Solves the damped normal equations `(H + damping · diag H) step = −g` and evaluates the trial parameters.
    ///
    /// Returns `None` if the system is not positive definite or the trial cannot be evaluated.
    fn try_step(&mut self, damping: f64) -> Option<Trial>;

    /// Makes the last trial the current parameters, with their linearisation. Returns the value of
    /// [`Problem::linearise`].
    fn accept(&mut self) -> Option<f64>;
}

/// A trial step.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// True cost at the trial parameters.
    pub cost: f64,
    /// Decrease of the cost that the quadratic model predicts.
    pub predicted_decrease: f64,
    /// Largest change of a parameter, each in the problem's own scale.
    pub step_size: f64,
}

/// Cost of an error of one standard deviation; costs are negative log probabilities.
const NEAR: f64 = 0.5;

/// Stopping rules and first damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LmOptions {
    /// Largest number of linearisations.
    pub max_iterations: usize,
    /// Stop if the cost falls by less than this fraction, and the model predicts no more.
    pub cost_tolerance: f64,
    /// Stop if no parameter changes by more than this.
    pub step_tolerance: f64,
    /// Stop if the scaled gradient is below this.
    pub gradient_tolerance: f64,
    /// Damping of the first step.
    pub initial_damping: f64,
    /// Largest number of rejected steps in a row.
    pub max_rejections: usize,
}

impl Default for LmOptions {
    fn default() -> Self {
        Self {
            max_iterations: 200,
            cost_tolerance: 1e-8,
            step_tolerance: 1e-9,
            gradient_tolerance: 1e-10,
            initial_damping: 1e-3,
            max_rejections: 12,
        }
    }
}

/// Reason why the loop stopped. The parameters are the best ones found; after `Failed` they are those of the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// The gradient is zero.
    Gradient,
    /// The cost no longer falls.
    Cost,
    /// The parameters no longer change.
    Step,
    /// No damping gives a lower cost: at the limit of the arithmetic, or next to parameters that cannot be evaluated.
    NoDescent,
    /// `max_iterations` was reached near the minimum: the last step predicted less than the cost of one sd.
    Near,
    /// `max_iterations` was reached.
    MaxIterations,
    /// The start cannot be evaluated; the parameters are unchanged.
    Failed,
}

impl Termination {
    /// Whether the parameters are a minimum, or near one within a fraction of an sd.
    #[must_use]
    pub fn converged(self) -> bool {
        !matches!(self, Self::MaxIterations | Self::Failed)
    }
}

/// Report of the loop.
#[derive(Clone, Copy, Debug)]
pub struct LmReport {
    /// Reason why the loop stopped.
    pub termination: Termination,
    /// Number of linearisations.
    pub iterations: usize,
    /// Cost at the end.
    pub cost: f64,
}

/// Minimises with Nielsen's damping (Madsen, Nielsen, Tingleff 2004, Alg. 3.16). A step is accepted only if the true
/// cost falls.
pub fn minimise<P: Problem>(problem: &mut P, options: &LmOptions) -> LmReport {
    let Some(mut gradient) = problem.linearise() else {
        return LmReport { termination: Termination::Failed, iterations: 0, cost: f64::INFINITY };
    };
    let mut damping = options.initial_damping;
    let mut growth = 2.0;
    let mut rejections = 0;
    let mut iterations = 1;
    let done = |termination, iterations, cost| LmReport { termination, iterations, cost };
    loop {
        let cost = problem.cost();
        if gradient <= options.gradient_tolerance {
            return done(Termination::Gradient, iterations, cost);
        }
        let trial = problem.try_step(damping);
        if let Some(trial) = trial.filter(|trial| trial.cost < cost && trial.predicted_decrease > 0.0) {
            let accepted = problem.accept();
            let decrease = cost - trial.cost;
            let gain = decrease / trial.predicted_decrease;
            damping = (damping * (1.0_f64 / 3.0).max(1.0 - (2.0 * gain - 1.0).powi(3))).max(1e-12);
            growth = 2.0;
            rejections = 0;
            let small = options.cost_tolerance * (trial.cost + f64::MIN_POSITIVE);
            let stop = if decrease <= small && trial.predicted_decrease <= small {
                Some(Termination::Cost)
            } else if trial.step_size <= options.step_tolerance {
                Some(Termination::Step)
            } else if iterations >= options.max_iterations {
                let near = trial.predicted_decrease < NEAR;
                Some(if near { Termination::Near } else { Termination::MaxIterations })
            } else {
                None
            };
            match accepted {
                Some(next) => gradient = next,
                None => return done(Termination::NoDescent, iterations, trial.cost),
            }
            if let Some(termination) = stop {
                return done(termination, iterations, problem.cost());
            }
            iterations += 1;
        } else {
            // A rejected step with almost no predicted decrease or almost no change is a rounding error at the minimum.
            if let Some(trial) = trial {
                if trial.predicted_decrease.abs() <= options.cost_tolerance * cost {
                    return done(Termination::Cost, iterations, cost);
                }
                if trial.step_size <= options.step_tolerance {
                    return done(Termination::Step, iterations, cost);
                }
            }
            damping *= growth;
            growth *= 2.0;
            rejections += 1;
            if rejections > options.max_rejections {
                return done(Termination::NoDescent, iterations, cost);
            }
        }
    }
}
