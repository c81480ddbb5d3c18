//! Numbers side by side in a SIMD register, so that the physics reads like physics.
//!
//! Each operation is one IEEE operation a lane, in the order written and never fused, so a lane has
//! the same bits on every instruction set and whatever its neighbours hold.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use std::ops::{Add, BitAnd, BitOr, Mul, Neg, Not, Sub};

use pulp::Simd;

/// Lanes of the widest register.
const WIDEST: usize = 8;

/// One `f64` a lane.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd> {
    simd: S,
    values: S::f64s,
}

/// One truth a lane.
#[derive(Clone, Copy)]
pub(crate) struct Mask<S: Simd> {
    simd: S,
    values: S::m64s,
}

/// Angles below which the last four terms of the series for [`Lanes::sin_cos`] are enough (rad).
const SMALL_ANGLE: f64 = 0.125;

/// Divisors of the Taylor series, the innermost first.
const SIN: [f64; 8] = [
    17.0 * 16.0,
    15.0 * 14.0,
    13.0 * 12.0,
    11.0 * 10.0,
    9.0 * 8.0,
    7.0 * 6.0,
    5.0 * 4.0,
    3.0 * 2.0,
];
const COS: [f64; 9] = [
    18.0 * 17.0,
    16.0 * 15.0,
    14.0 * 13.0,
    12.0 * 11.0,
    10.0 * 9.0,
    8.0 * 7.0,
    6.0 * 5.0,
    4.0 * 3.0,
    2.0,
];

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(crate) fn splat(simd: S, value: f64) -> Self {
        let values = simd.splat_f64s(value);
        Self { simd, values }
    }

    /// One value for each lane; `of` is asked for the lane's number.
    #[inline(always)]
    pub(crate) fn from_fn(simd: S, mut of: impl FnMut(usize) -> f64) -> Self {
        let mut all = [0.0; WIDEST];
        for (lane, value) in all[..S::F64_LANES].iter_mut().enumerate() {
            *value = of(lane);
        }
        let values = S::as_simd_f64s(&all[..S::F64_LANES]).0[0];
        Self { simd, values }
    }

    /// The lanes' values; what stands behind the last lane is zero.
    #[inline(always)]
    pub(crate) fn to_array(self) -> [f64; WIDEST] {
        let mut all = [0.0; WIDEST];
        S::as_mut_simd_f64s(&mut all[..S::F64_LANES]).0[0] = self.values;
        all
    }

    /// The same value in every lane.
    #[inline(always)]
    pub(crate) fn like(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }

    #[inline(always)]
    fn with(self, values: S::f64s) -> Self {
        Self { values, ..self }
    }

    #[inline(always)]
    fn mask(self, values: S::m64s) -> Mask<S> {
        Mask {
            simd: self.simd,
            values,
        }
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        self.with(self.simd.sqrt_f64s(self.values))
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        self.with(self.simd.abs_f64s(self.values))
    }

    /// Division; not an operator, because it costs as much as ten of the others.
    #[inline(always)]
    pub(crate) fn over(self, divisor: Self) -> Self {
        self.with(self.simd.div_f64s(self.values, divisor.values))
    }

    #[inline(always)]
    pub(crate) fn lt(self, other: Self) -> Mask<S> {
        self.mask(self.simd.less_than_f64s(self.values, other.values))
    }

    #[inline(always)]
    pub(crate) fn le(self, other: Self) -> Mask<S> {
        self.mask(self.simd.less_than_or_equal_f64s(self.values, other.values))
    }

    #[inline(always)]
    pub(crate) fn ne(self, other: Self) -> Mask<S> {
        !self.mask(self.simd.equal_f64s(self.values, other.values))
    }

    #[inline(always)]
    pub(crate) fn gt(self, other: Self) -> Mask<S> {
        other.lt(self)
    }

    #[inline(always)]
    pub(crate) fn ge(self, other: Self) -> Mask<S> {
        other.le(self)
    }

    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        self.lt(other).select(self, other)
    }

    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        self.gt(other).select(self, other)
    }

    /// Sine and cosine by their Taylor series: exact to 5e-14 up to a right angle, to the last bits on
    /// the tilts of a labyrinth.
    #[inline(always)]
    pub(crate) fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = (self * self.series(&SIN[4..]), self.series(&COS[4..]));
        let steep = self.abs().gt(self.like(SMALL_ANGLE));
        if steep.any() {
            let (long_sin, long_cos) = (self * self.series(&SIN), self.series(&COS));
            return (steep.select(long_sin, sin), steep.select(long_cos, cos));
        }
        (sin, cos)
    }

    /// 1 - x²/a (1 - x²/b (...)), the innermost divisor first.
    #[inline(always)]
    fn series(self, divisors: &[f64]) -> Self {
        let (one, square) = (self.like(1.0), self * self);
        divisors
            .iter()
            .fold(one, |sum, divisor| one - (1.0 / divisor) * (square * sum))
    }

    /// Exponential of a number that is not above zero, to 1e-10 of its value; below -25 it is zero.
    #[inline(always)]
    pub(crate) fn exp_decay(self) -> Self {
        let far = self.lt(self.like(-25.0));
        // The Taylor series of a 512th part, squared nine times.
        let (one, part) = (self.like(1.0), 1.0 / 512.0 * self);
        let mut power = (1..=6)
            .rev()
            .fold(one, |sum, n| one + (1.0 / f64::from(n)) * (part * sum));
        for _ in 0..9 {
            power = power * power;
        }
        far.select(self.like(0.0), power)
    }

    /// The nearest whole number, the even one of two; for numbers below 2⁵¹.
    #[inline(always)]
    pub(crate) fn round(self) -> Self {
        let magic = self.like(6_755_399_441_055_744.0); // 1.5 × 2⁵²: no room is left for a fraction
        (self + magic) - magic
    }

    /// The instruction set.
    #[inline(always)]
    pub(crate) fn simd(self) -> S {
        self.simd
    }

    /// The nearest value from -bound to bound.
    #[inline(always)]
    pub(crate) fn clamp(self, bound: Self) -> Self {
        self.min(bound).max(-bound)
    }
}

impl<S: Simd> Mask<S> {
    #[inline(always)]
    pub(crate) fn select(self, if_true: Lanes<S>, if_false: Lanes<S>) -> Lanes<S> {
        if_true.with(
            self.simd
                .select_f64s(self.values, if_true.values, if_false.values),
        )
    }

    #[inline(always)]
    pub(crate) fn any(self) -> bool {
        self.simd.first_true_m64s(self.values) != S::F64_LANES
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(self.simd.add_f64s(self.values, other.values))
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(self.simd.sub_f64s(self.values, other.values))
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(self.simd.mul_f64s(self.values, other.values))
    }
}

impl<S: Simd> Mul<Lanes<S>> for f64 {
    type Output = Lanes<S>;

    #[inline(always)]
    fn mul(self, other: Lanes<S>) -> Lanes<S> {
        Lanes::splat(other.simd, self) * other
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self.simd.neg_f64s(self.values))
    }
}

impl<S: Simd> BitAnd for Mask<S> {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        let values = self.simd.and_m64s(self.values, other.values);
        Self { values, ..self }
    }
}

impl<S: Simd> BitOr for Mask<S> {
    type Output = Self;

    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        let values = self.simd.or_m64s(self.values, other.values);
        Self { values, ..self }
    }
}

impl<S: Simd> Not for Mask<S> {
    type Output = Self;

    #[inline(always)]
    fn not(self) -> Self {
        let values = self.simd.not_m64s(self.values);
        Self { values, ..self }
    }
}
