//! Forward-mode dual numbers: exact derivatives to check Jacobians against.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value with its derivatives by up to 20 unknowns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual {
    pub value: f64,
    pub by: [f64; 20],
}

impl Dual {
    pub fn constant(value: f64) -> Self {
        Self { value, by: [0.0; 20] }
    }

    /// The unknown number `index`.
    pub fn unknown(value: f64, index: usize) -> Self {
        let mut dual = Self::constant(value);
        dual.by[index] = 1.0;
        dual
    }

    fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, by: self.by.map(|d| d * slope) }
    }

    pub fn exp(self) -> Self {
        self.chain(self.value.exp(), self.value.exp())
    }

    pub fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }

    pub fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }

    fn join(self, other: Self, value: f64, a: f64, b: f64) -> Self {
        Self { value, by: std::array::from_fn(|i| a * self.by[i] + b * other.by[i]) }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.join(other, self.value + other.value, 1.0, 1.0)
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.join(other, self.value - other.value, 1.0, -1.0)
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.join(other, self.value * other.value, other.value, self.value)
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        self.join(other, value, 1.0 / other.value, -value / other.value)
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

/// Three of them.
pub(crate) type Vector = [Dual; 3];

/// A constant vector.
pub(crate) fn constant(v: &nalgebra::Vector3<f64>) -> Vector {
    [v.x, v.y, v.z].map(Dual::constant)
}

/// `a + b`.
pub(crate) fn plus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

/// `a · b`.
pub(crate) fn dot(a: Vector, b: Vector) -> Dual {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a v`.
pub(crate) fn scaled(v: Vector, a: Dual) -> Vector {
    v.map(|c| c * a)
}

/// `a × b`.
pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Axes right, forward, up of the world seen from a camera of this tilt and roll.
pub(crate) fn world_axes(tilt: Dual, roll: Dual) -> [Vector; 3] {
    let (st, ct, sr, cr) = (tilt.sin(), tilt.cos(), roll.sin(), roll.cos());
    [[cr, sr, Dual::constant(0.0)], [sr * st, -(cr * st), ct], [sr * ct, -(cr * ct), -st]]
}

/// The largest difference of two rows relative to the larger entry or a thousandth of the row's largest.
pub(crate) fn relative_difference(a: &[f64], b: &[f64]) -> f64 {
    let largest = a.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / a.abs().max(1e-3 * largest)).fold(0.0, f64::max)
}
