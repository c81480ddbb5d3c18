//! A picture that turns and grows with the board's tilt.

use pulp::Simd;

use crate::motion::Pair;

#[derive(Clone)]
pub(super) struct Picture<S: Simd> {
    /// Angle from x towards y (rad), and growth, for each radian of the board about x and about y.
    turn: Pair<S>,
    growth: Pair<S>,
}

impl<S: Simd> Picture<S> {
    pub(super) fn new(turn: Pair<S>, growth: Pair<S>) -> Self {
        Self { turn, growth }
    }

    #[inline(always)]
    pub(super) fn see(&self, seen: &mut Pair<S>, tilt: &Pair<S>) {
        let along = |rates: &Pair<S>| rates[0] * tilt[0] + rates[1] * tilt[1];
        let (sin, cos) = along(&self.turn).sin_cos_of_any();
        let (size, [x, y]) = (sin.like(1.0) + along(&self.growth), *seen);
        *seen = [size * (x * cos - y * sin), size * (x * sin + y * cos)];
    }
}
