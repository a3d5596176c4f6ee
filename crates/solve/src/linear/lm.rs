//! The loop of the Levenberg–Marquardt method: damping and stopping rules.
//!
//! A [`Problem`] computes and solves the normal equations, so it can use their structure.

/// A least-squares problem for [`minimise`]. It stores its parameters, its linearisation and a trial step.
pub trait Problem {
    /// Computes residuals, Jacobians and normal equations at the current parameters.
    ///
    /// Returns the largest absolute entry of the scaled gradient (zero at a minimum), or `None` if the parameters
    /// cannot be evaluated.
    fn linearise(&mut self) -> Option<f64>;

    /// Returns the cost that the last linearisation computed, at the current parameters.
    fn cost(&self) -> f64;

    /// Solves the damped normal equations `(H + damping · diag H) step = −g` and evaluates the cost after the step.
    ///
    /// H is the Hessian and g the gradient of the cost. Returns `None` if the equations are not positive definite or
    /// the trial parameters cannot be evaluated.
    fn try_step(&mut self, damping: f64) -> Option<Trial>;

    /// Replaces the current parameters by those of the last trial step, and linearises there.
    ///
    /// Returns the same value as [`Problem::linearise`].
    fn accept(&mut self) -> Option<f64>;
}

/// Predicted and true effect of a trial step.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// True cost at the trial parameters.
    pub cost: f64,
    /// Decrease of the cost that the quadratic model predicts.
    pub predicted_decrease: f64,
    /// Largest change of any parameter, in units that the problem chooses for each parameter.
    pub step_size: f64,
}

/// Cost of an error of one standard deviation, since the cost is a negative log probability.
const NEAR: f64 = 0.5;

/// Stopping rules and first damping of the Levenberg–Marquardt loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LmOptions {
    /// Largest number of linearisations.
    pub max_iterations: usize,
    /// Relative decrease of the cost at which the loop stops. True and predicted decrease must both be this small.
    pub cost_tolerance: f64,
    /// Largest change of a parameter ([`Trial::step_size`]) at which the loop stops.
    pub step_tolerance: f64,
    /// Largest entry of the scaled gradient ([`Problem::linearise`]) at which the loop stops.
    pub gradient_tolerance: f64,
    /// Damping of the first step.
    pub initial_damping: f64,
    /// Largest number of consecutive rejected steps.
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

/// Reason why the loop stopped.
///
/// The problem's parameters are then the best that were found. After `Failed` they are unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// The gradient is zero within its tolerance.
    Gradient,
    /// The cost no longer decreases.
    Cost,
    /// The parameters no longer change.
    Step,
    /// No damping gives a lower cost, because of rounding or because nearby parameters cannot be evaluated.
    NoDescent,
    /// `max_iterations` was reached near the minimum.
    ///
    /// The last step was predicted to decrease the cost by less than 0.5, which is the cost of an error of one sd.
    Near,
    /// `max_iterations` was reached, and the minimum is not near.
    MaxIterations,
    /// The cost cannot be evaluated at the start.
    Failed,
}

impl Termination {
    /// Whether the parameters are at a minimum, or within a fraction of an sd of a minimum.
    #[must_use]
    pub fn converged(self) -> bool {
        !matches!(self, Self::MaxIterations | Self::Failed)
    }
}

/// Report of one run of [`minimise`].
#[derive(Clone, Copy, Debug)]
pub struct LmReport {
    /// Reason why the loop stopped.
    pub termination: Termination,
    /// Number of linearisations.
    pub iterations: usize,
    /// Cost at the final parameters.
    pub cost: f64,
}

/// Minimises the cost of a problem by the Levenberg–Marquardt method.
///
/// The damping follows Nielsen (Madsen, Nielsen, Tingleff 2004, Alg. 3.16). A step is accepted only if the true cost
/// decreases.
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
            // If the rejected step is tiny or predicts almost no decrease, only rounding errors at the minimum remain.
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
