//! Test of the Levenberg–Marquardt loop on NIST's nonlinear regressions (Statistical Reference Datasets, StRD).
//!
//! Each regression is solved from both of its start values. The score is the one that Ceres uses (`examples/nist.cc`).
//! The log relative error (LRE) of a fit is the number of correct digits of its worst parameter, at most 11. Correct
//! digits agree with NIST's certified value. A fit succeeds with four correct digits.

#![allow(clippy::unwrap_used, clippy::panic)] // the functions below are test code, too

use std::f64::consts::PI;
use std::path::Path;

use nalgebra::{Complex, DMatrix, DVector};
use roadplane_solve::{LmOptions, Problem, Trial, minimise};

/// A complex number. A tiny imaginary step gives derivatives that are exact up to rounding (Squire and Trapp 1998).
type C = Complex<f64>;
const STEP: f64 = 1e-40;

/// Returns the prediction of the named regression model at `x` with the parameters `b`.
fn predicted(name: &str, x: &[f64], b: &[C]) -> C {
    let two = x.get(1).copied().unwrap_or_default();
    let x = x[0];
    let one = C::from(1.0);
    let gauss = |height: C, at: C, width: C| height * (-((C::from(x) - at) / width).powi(2)).exp();
    match name {
        "Misra1a" | "BoxBOD" => b[0] * (one - (-b[1] * x).exp()),
        "Misra1b" => b[0] * (one - (one + b[1] * x / 2.0).powi(-2)),
        "Misra1c" => b[0] * (one - (one + b[1] * x * 2.0).powf(-0.5)),
        "Misra1d" => b[0] * b[1] * x / (one + b[1] * x),
        "Chwirut1" | "Chwirut2" => (-b[0] * x).exp() / (b[1] + b[2] * x),
        "Lanczos1" | "Lanczos2" | "Lanczos3" => {
            b[0] * (-b[1] * x).exp() + b[2] * (-b[3] * x).exp() + b[4] * (-b[5] * x).exp()
        }
        "Gauss1" | "Gauss2" | "Gauss3" => {
            b[0] * (-b[1] * x).exp() + gauss(b[2], b[3], b[4]) + gauss(b[5], b[6], b[7])
        }
        "DanWood" => b[0] * (b[1] * x.ln()).exp(),
        "Kirby2" => (b[0] + b[1] * x + b[2] * x * x) / (one + b[3] * x + b[4] * x * x),
        "Hahn1" | "Thurber" => {
            let (square, cube) = (x * x, x * x * x);
            (b[0] + b[1] * x + b[2] * square + b[3] * cube) / (one + b[4] * x + b[5] * square + b[6] * cube)
        }
        "Nelson" => b[0] - b[1] * x * (-b[2] * two).exp(),
        "MGH17" => b[0] + b[1] * (-b[3] * x).exp() + b[2] * (-b[4] * x).exp(),
        "MGH09" => b[0] * (b[1] * x + x * x) / (b[2] * x + x * x + b[3]),
        "MGH10" => b[0] * (b[1] / (b[2] + x)).exp(),
        "Roszman1" => b[0] - b[1] * x - atan(b[2] / (-b[3] + x)) / PI,
        "ENSO" => {
            let wave = |period: C| C::from(2.0 * PI * x) / period;
            let year = wave(C::from(12.0));
            b[0] + b[1] * year.cos()
                + b[2] * year.sin()
                + b[4] * wave(b[3]).cos()
                + b[5] * wave(b[3]).sin()
                + b[7] * wave(b[6]).cos()
                + b[8] * wave(b[6]).sin()
        }
        "Rat42" => b[0] / (one + (b[1] - b[2] * x).exp()),
        "Rat43" => b[0] * (-(one + (b[1] - b[2] * x).exp()).ln() / b[3]).exp(),
        "Eckerle4" => b[0] / b[1] * (((-b[2] + x) / b[1]).powi(2) * -0.5).exp(),
        "Bennett5" => b[0] * (-(b[1] + x).ln() / b[2]).exp(),
        _ => panic!("{name}: no model"),
    }
}

/// Returns the arctangent of a complex number. The library's own function would lose the tiny imaginary part.
fn atan(z: C) -> C {
    C::new(z.re.atan(), z.im / (1.0 + z.re * z.re))
}

/// A nonlinear regression problem, read from one of NIST's files.
struct Regression {
    name: String,
    starts: [Vec<f64>; 2],
    certified: Vec<f64>,
    /// Data rows. In each row, the response comes first and the predictors follow.
    data: Vec<Vec<f64>>,
}

fn read(path: &Path) -> Regression {
    let text = std::fs::read_to_string(path).unwrap();
    let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
    let numbers = |line: &str| line.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>().ok();
    let of_parameter = |line: &str| {
        let (left, right) = line.split_once('=')?;
        left.trim().strip_prefix('b')?.parse::<usize>().ok()?;
        numbers(right).filter(|values| values.len() == 4)
    };
    let parameters: Vec<Vec<f64>> = text.lines().filter_map(of_parameter).collect();
    let column = |i: usize| parameters.iter().map(|row| row[i]).collect::<Vec<f64>>();
    // The data are at the end, below the second line that starts with "Data:".
    let from = text.rmatch_indices("\nData:").next().unwrap().0;
    let rows = text[from..].lines().filter_map(|line| numbers(line).filter(|row| row.len() > 1));
    let mut data: Vec<Vec<f64>> = rows.collect();
    if name == "Nelson" {
        data.iter_mut().for_each(|row| row[0] = row[0].ln());
    }
    assert!(parameters.len() > 1 && data.len() > parameters.len(), "{name}");
    Regression { name, starts: [column(0), column(1)], certified: column(2), data }
}

struct Fit<'a> {
    of: &'a Regression,
    b: DVector<f64>,
    trial: DVector<f64>,
    cost: f64,
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl<'a> Fit<'a> {
    fn new(of: &'a Regression, start: &[f64]) -> Self {
        let count = start.len();
        let b = DVector::from_column_slice(start);
        let (hessian, gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        Self { of, trial: b.clone(), b, cost: f64::INFINITY, hessian, gradient }
    }

    fn residuals(&self, b: &[C]) -> DVector<C> {
        let of = self.of;
        let rows = of.data.iter().map(|row| predicted(&of.name, &row[1..], b) - row[0]);
        DVector::from_iterator(of.data.len(), rows)
    }

    fn cost_at(&self, b: &DVector<f64>) -> Option<f64> {
        let b: Vec<C> = b.iter().map(|value| C::from(*value)).collect();
        let cost = 0.5 * self.residuals(&b).iter().map(|r| r.re * r.re).sum::<f64>();
        cost.is_finite().then_some(cost)
    }
}

impl Problem for Fit<'_> {
    fn linearise(&mut self) -> Option<f64> {
        self.cost = self.cost_at(&self.b)?;
        let at = |changed: usize| -> Vec<C> {
            let change = |i: usize| if i == changed { STEP } else { 0.0 };
            self.b.iter().enumerate().map(|(i, value)| C::new(*value, change(i))).collect()
        };
        let columns: Vec<DVector<C>> = (0..self.b.len()).map(|i| self.residuals(&at(i))).collect();
        let jacobian = DMatrix::from_fn(self.of.data.len(), self.b.len(), |row, i| columns[i][row].im / STEP);
        let residuals = columns[0].map(|r| r.re);
        self.hessian = jacobian.tr_mul(&jacobian);
        self.gradient = jacobian.tr_mul(&residuals);
        let scale = residuals.norm().max(f64::MIN_POSITIVE);
        let cosine =
            |i: usize| self.gradient[i].abs() / (self.hessian[(i, i)].sqrt() * scale).max(f64::MIN_POSITIVE);
        let largest = (0..self.b.len()).map(cosine).fold(0.0, f64::max);
        (jacobian.iter().all(|v| v.is_finite()) && largest.is_finite()).then_some(largest)
    }

    fn cost(&self) -> f64 {
        self.cost
    }

    fn try_step(&mut self, damping: f64) -> Option<Trial> {
        // The equations are scaled so that every column of the Jacobian has length 1.
        let unit = self.hessian.diagonal().map(|d| 1.0 / d.sqrt().max(1e-300));
        let mut scaled =
            DMatrix::from_fn(unit.len(), unit.len(), |i, j| unit[i] * self.hessian[(i, j)] * unit[j]);
        (0..unit.len()).for_each(|i| scaled[(i, i)] += damping);
        let step = scaled.cholesky()?.solve(&-self.gradient.component_mul(&unit)).component_mul(&unit);
        self.trial = &self.b + &step;
        let predicted_decrease = -self.gradient.dot(&step) - 0.5 * step.dot(&(&self.hessian * &step));
        let relative = |(step, b): (&f64, &f64)| step.abs() / b.abs().max(1e-300);
        let step_size = step.iter().zip(&self.b).map(relative).fold(0.0, f64::max);
        Some(Trial { cost: self.cost_at(&self.trial)?, predicted_decrease, step_size })
    }

    fn accept(&mut self) -> Option<f64> {
        self.b.copy_from(&self.trial);
        self.linearise()
    }
}

/// Returns the number of correct digits of the worst parameter: digits that agree with the certified value.
fn digits(found: &DVector<f64>, certified: &[f64]) -> f64 {
    let of = |(found, true_value): (&f64, &f64)| {
        -((found - true_value).abs() / true_value.abs()).max(1e-11).log10()
    };
    found.iter().zip(certified).map(of).fold(11.0, f64::min).max(0.0)
}

#[test]
fn nists_regressions_come_out_to_four_digits() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/nist");
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "dat"));
    paths.sort();
    let options = LmOptions {
        max_iterations: 2000,
        cost_tolerance: 1e-15,
        step_tolerance: 1e-14,
        gradient_tolerance: 1e-14,
        max_rejections: 40,
        ..LmOptions::default()
    };
    let (mut solved, mut sum, mut tried) = (0, 0.0, 0);
    for path in &paths {
        let regression = read(path);
        for (i, start) in regression.starts.iter().enumerate() {
            let mut fit = Fit::new(&regression, start);
            let report = minimise(&mut fit, &options);
            let lre = digits(&fit.b, &regression.certified);
            println!("{:9} start {}: {lre:4.1} digits, {report:?}", regression.name, i + 1);
            tried += 1;
            sum += lre;
            solved += u32::from(lre >= 4.0);
        }
    }
    let average = sum / f64::from(tried);
    println!("{solved} of {tried}, average LRE {average:.2}");
    assert_eq!(tried, 54);
    // From the start that is farther from the solution, BoxBOD, MGH10 and MGH17 find other minima or do not converge.
    assert!(solved >= 51 && average > 8.0, "{solved} of {tried}, {average}");
}
