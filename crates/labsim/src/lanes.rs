//! Numbers side by side in a SIMD register, so that the physics reads like physics.
//!
//! Each operation is one IEEE operation a lane, in the order written and never fused, so a lane has
//! the same bits on every instruction set, independent of its neighbours.

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

/// Angles below which the first [`SMALL_TERMS`] of the series for [`Lanes::sin_cos`] are enough (rad).
const SMALL_ANGLE: f64 = 0.125;
const SMALL_TERMS: usize = 5;

/// Coefficients of the Taylor series in the square of the angle; the sine's is over the angle.
const SIN: [f64; 9] = taylor(1);
const COS: [f64; 10] = taylor(0);

/// 1 over the factorials of every second number from `first` on, which is 0 or 1, with alternating signs.
const fn taylor<const N: usize>(first: usize) -> [f64; N] {
    let mut coefficients = [1.0; N];
    let mut i = 1;
    while i < N {
        let number = (first + 2 * i) as f64;
        coefficients[i] = -coefficients[i - 1] / (number * (number - 1.0));
        i += 1;
    }
    coefficients
}

/// Coefficients of the series of the inverse hyperbolic tangent in the square, over the number.
const INVERSE_TANH: [f64; 9] = {
    let mut coefficients = [1.0; 9];
    let mut i = 1;
    while i < 9 {
        coefficients[i] = 1.0 / (2 * i + 1) as f64;
        i += 1;
    }
    coefficients
};

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(crate) fn splat(simd: S, value: f64) -> Self {
        let values = simd.splat_f64s(value);
        Self { simd, values }
    }

    /// One value for each lane; `of` maps the lane's number to its value.
    #[inline(always)]
    pub(crate) fn from_fn(simd: S, mut of: impl FnMut(usize) -> f64) -> Self {
        let mut all = [0.0; WIDEST];
        for (lane, value) in all[..S::F64_LANES].iter_mut().enumerate() {
            *value = of(lane);
        }
        Self::load(simd, &all)
    }

    /// The first values, one for each lane.
    #[inline(always)]
    pub(crate) fn load(simd: S, all: &[f64; WIDEST]) -> Self {
        let values = S::as_simd_f64s(&all[..S::F64_LANES]).0[0];
        Self { simd, values }
    }

    /// The lanes' values; entries after the last lane are zero.
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
        let square = self * self;
        let (sin, cos) = (
            self * square.polynomial(&SIN[..SMALL_TERMS]),
            square.polynomial(&COS[..SMALL_TERMS]),
        );
        let steep = self.abs().gt(self.like(SMALL_ANGLE));
        if steep.any() {
            let (long_sin, long_cos) = (self * square.polynomial(&SIN), square.polynomial(&COS));
            return (steep.select(long_sin, sin), steep.select(long_cos, cos));
        }
        (sin, cos)
    }

    /// Sine and cosine of any angle to the last bit, lane by lane: slow, for values that are computed once.
    pub(crate) fn sin_cos_of_any(self) -> (Self, Self) {
        let angles = self.to_array();
        (
            Self::from_fn(self.simd, |lane| libm::sin(angles[lane])),
            Self::from_fn(self.simd, |lane| libm::cos(angles[lane])),
        )
    }

    /// A polynomial by Horner's rule; the constant coefficient comes first.
    #[inline(always)]
    fn polynomial(self, coefficients: &[f64]) -> Self {
        let [rest @ .., highest] = coefficients else {
            return self.like(0.0);
        };
        rest.iter()
            .rev()
            .fold(self.like(*highest), |sum, &coefficient| {
                self.like(coefficient) + self * sum
            })
    }

    /// Cosine of any angle, to 1e-13 within some turns of zero.
    #[inline(always)]
    pub(crate) fn cos(self) -> Self {
        use std::f64::consts::{PI, TAU};
        let half = 0.5 * self - PI * (1.0 / TAU * self).round();
        let sin = half * (half * half).polynomial(&SIN);
        self.like(1.0) - 2.0 * (sin * sin)
    }

    /// Natural logarithm of a number from 1e-9 to 1, to 1e-13.
    #[inline(always)]
    pub(crate) fn ln_of_part(self) -> Self {
        // Of the 64th root, which is near one, by the series of the inverse hyperbolic tangent.
        let (one, root) = (self.like(1.0), (0..6).fold(self, |root, _| root.sqrt()));
        let tangent = (root - one).over(root + one);
        128.0 * (tangent * (tangent * tangent).polynomial(&INVERSE_TANH))
    }

    /// Exponential of a number that is not above zero, to 1e-11 of its value; below -25 it is zero.
    #[inline(always)]
    pub(crate) fn exp_decay(self) -> Self {
        let far = self.lt(self.like(-25.0));
        // The Taylor series of a 2048th part, squared eleven times. Two terms at a time, since a number
        // waits longer for the one before it than the register takes for both.
        let part = 1.0 / 2048.0 * self;
        let square = part * part;
        let two = |a: f64, b: f64| self.like(a) + b * part;
        let low = two(1.0, 1.0) + square * two(1.0 / 2.0, 1.0 / 6.0);
        let mut power = low + square * square * two(1.0 / 24.0, 1.0 / 120.0);
        for _ in 0..11 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use pulp::Scalar;

    fn of(value: f64) -> Lanes<Scalar> {
        Lanes::splat(Scalar, value)
    }

    proptest! {
        #[test]
        fn sine_and_cosine_are_exact_on_small_angles_and_near_it_on_steep_ones(
            part in -1.0..1.0_f64, steepest in prop::sample::select(vec![SMALL_ANGLE, std::f64::consts::FRAC_PI_2]),
        ) {
            let angle: f64 = part * steepest;
            let (sin, cos) = of(angle).sin_cos();
            let bound = if steepest == SMALL_ANGLE { 4e-16 } else { 5e-14 };
            prop_assert!((sin.to_array()[0] - angle.sin()).abs() <= bound);
            prop_assert!((cos.to_array()[0] - angle.cos()).abs() <= bound);
        }

        #[test]
        fn the_cosine_of_any_angle_has_thirteen_digits(angle in -20.0..20.0_f64, turns in 0.0..1e4_f64) {
            prop_assert!((of(angle).cos().to_array()[0] - angle.cos()).abs() <= 2e-13);
            let far = angle + std::f64::consts::TAU * turns.round();
            prop_assert!((of(far).cos().to_array()[0] - far.cos()).abs() <= 4e-11);
        }

        #[test]
        fn the_logarithm_of_a_part_has_thirteen_digits(ln in -20.7..0.0_f64) {
            prop_assert!((of(ln.exp()).ln_of_part().to_array()[0] - ln.exp().ln()).abs() <= 1e-13);
        }

        #[test]
        fn the_exponential_has_eleven_digits(way in 0.0..25.0_f64) {
            let found = of(-way).exp_decay().to_array()[0];
            prop_assert!((found / (-way).exp() - 1.0).abs() <= 1e-11);
        }
    }

    #[test]
    fn the_exponential_begins_at_one_and_ends_at_zero() {
        assert_eq!(of(0.0).exp_decay().to_array()[0], 1.0);
        assert_eq!(of(-25.1).exp_decay().to_array()[0], 0.0);
        assert_eq!(of(f64::NEG_INFINITY).exp_decay().to_array()[0], 0.0);
    }
}
