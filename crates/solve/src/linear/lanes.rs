//! Arithmetic on four numbers side by side, one for each of four keypoints.
//!
//! The compiler turns these plain arrays into vector instructions. The code never uses a fused multiply-add, so every
//! machine computes the same bits.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use nalgebra::{Matrix3, Vector3};

/// Number of keypoints that the inner loop processes at a time.
pub(crate) const LANES: usize = 4;

/// Four numbers, one in each lane of a vector register.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Lanes(pub [f64; LANES]);

impl Lanes {
    #[inline(always)]
    pub const fn splat(value: f64) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    pub fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self([f(self.0[0]), f(self.0[1]), f(self.0[2]), f(self.0[3])])
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let (a, b) = (self.0, other.0);
        Self([f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])])
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        self.map(f64::abs)
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// Returns in each lane the value of `then` if `self < limit`, and the value of `otherwise` if not.
    #[inline(always)]
    pub fn select_below(self, limit: f64, then: Self, otherwise: Self) -> Self {
        let pick = |i: usize| if self.0[i] < limit { then.0[i] } else { otherwise.0[i] };
        Self([pick(0), pick(1), pick(2), pick(3)])
    }

    /// Returns the sum of the lanes, added in a fixed order.
    #[inline(always)]
    pub fn sum(self) -> f64 {
        (self.0[0] + self.0[2]) + (self.0[1] + self.0[3])
    }

    /// Returns `e^(−x)` for x ≥ 0, with an error of at most 1 unit in the last place. An x above 700 counts as 700.
    ///
    /// Range reduction and rational approximation are those of fdlibm's `e_exp.c` (Sun Microsystems 1993).
    #[inline(always)]
    pub fn exp_of_minus(self) -> Self {
        /// The number 1.5 · 2⁵². A sum with it is rounded to an integer, which is in the lowest bits of the sum.
        const ROUND: f64 = 6_755_399_441_055_744.0;
        const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
        const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
        let x = self.min(Self::splat(700.0));
        let shifted = x * Self::splat(-std::f64::consts::LOG2_E) + Self::splat(ROUND);
        let n = shifted - Self::splat(ROUND);
        let high = -x - n * Self::splat(LN2_HIGH);
        let low = n * Self::splat(LN2_LOW);
        let r = high - low;
        let t = r * r;
        let p = Self::horner(
            t,
            [
                4.138_136_797_057_238_5e-8,
                -1.653_390_220_546_525_2e-6,
                6.613_756_321_437_934e-5,
                -2.777_777_777_701_559_3e-3,
                1.666_666_666_666_660_2e-1,
            ],
        );
        let c = r - t * p;
        let one = Self::splat(1.0);
        let mantissa = one - ((low - r * c / (Self::splat(2.0) - c)) - high);
        mantissa * shifted.map(|s| f64::from_bits((s.to_bits() << 52).wrapping_add(1023 << 52)))
    }

    /// Returns `ln(1 + x)` for 0 ≤ x ≤ 1, with an error of a few units in the last place, even for small x.
    ///
    /// The polynomial is that of fdlibm's `e_log.c`.
    #[inline(always)]
    pub fn ln_1p_to_one(self) -> Self {
        use std::f64::consts::{FRAC_1_SQRT_2, LN_2, SQRT_2};
        // Range reduction: 1 + x is (1 + f) or √2 (1 + f), with |f| < 0.42.
        let limit = SQRT_2 - 1.0;
        let f = self.select_below(limit, self, (self - Self::splat(limit)) * Self::splat(FRAC_1_SQRT_2));
        let rest = self.select_below(limit, Self::splat(0.0), Self::splat(0.5 * LN_2));
        let z = f / (Self::splat(2.0) + f);
        let t = z * z;
        let p = Self::horner(
            t,
            [
                1.479_819_860_511_658_6e-1,
                1.531_383_769_920_937_3e-1,
                1.818_357_216_161_805e-1,
                2.222_219_843_214_978_4e-1,
                2.857_142_874_366_239e-1,
                3.999_999_999_940_942e-1,
                6.666_666_666_666_735e-1,
            ],
        );
        let half_square = Self::splat(0.5) * f * f;
        rest + (f - (half_square - z * (half_square + t * p)))
    }

    /// Evaluates a polynomial in x. The coefficient of the highest power is the first.
    #[inline(always)]
    fn horner<const N: usize>(x: Self, coefficients: [f64; N]) -> Self {
        let mut sum = Self::splat(coefficients[0]);
        for coefficient in &coefficients[1..] {
            sum = sum * x + Self::splat(*coefficient);
        }
        sum
    }
}

macro_rules! lane_by_lane {
    ($($operation:ident $function:ident $sign:tt),*) => {$(
        impl $operation for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, |a, b| a $sign b)
            }
        }
    )*};
}

lane_by_lane!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Four 3D vectors side by side, one per lane.
pub(crate) type Point = [Lanes; 3];

/// Returns the same vector in all lanes.
#[inline(always)]
pub(crate) fn splat(v: &Vector3<f64>) -> Point {
    [Lanes::splat(v.x), Lanes::splat(v.y), Lanes::splat(v.z)]
}

/// Returns `a + b`.
#[inline(always)]
pub(crate) fn sum(a: &Point, b: &Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Returns `a · b`.
#[inline(always)]
pub(crate) fn dot(a: &Point, b: &Point) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns `a × b`.
#[inline(always)]
pub(crate) fn cross(a: &Point, b: &Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns `m v`.
#[inline(always)]
pub(crate) fn turned(m: &Matrix3<f64>, v: &Point) -> Point {
    let row = |i: usize| dot(&[Lanes::splat(m[(i, 0)]), Lanes::splat(m[(i, 1)]), Lanes::splat(m[(i, 2)])], v);
    [row(0), row(1), row(2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_exact() {
        for step in 0..70_000 {
            let x = 0.01 * f64::from(step);
            let found = Lanes::splat(x).exp_of_minus().0[2];
            assert!((found / (-x).exp() - 1.0).abs() < 4e-16, "e^-{x} = {found}");
        }
        for step in 0..=10_000 {
            for x in [f64::from(step) / 10_000.0, (-f64::from(step) / 20.0).exp()] {
                let (found, exact) = (Lanes::splat(x).ln_1p_to_one().0[1], x.ln_1p());
                assert!((found - exact).abs() <= 4e-16 * exact, "ln(1 + {x}) = {found}, not {exact}");
            }
        }
        assert!(Lanes::splat(f64::INFINITY).exp_of_minus().0[0] < 1e-300);
    }
}
