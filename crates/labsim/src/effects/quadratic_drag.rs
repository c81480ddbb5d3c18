//! Resistance in proportion to the square of the speed.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "quadratic_drag",
    stage: Stage::Air,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    equation: "dv/dt = -q |v| v",
    parameters: &[Parameter {
        name: "coefficient_per_m",
        unit: "1/m",
        range: (0.0, 20.0),
        neutral: 0.0,
        allowed: (0.0, 1e4),
        time_power: 0,
        optional: false,
        reach: None,
        means: "q, part of the velocity that is lost on each metre of the way",
    }],
    does: "The marble loses a fixed part of its speed on each metre: air that it has to push aside. On a steel marble that \
           is some thousandths of 1/m; what a fit finds beyond stands for another loss on the way.",
    matters: "At high speed only: at half the speed it brakes a quarter as much.",
    looks: "A coasting marble slows as v/(1 + q v t): fast at first, hardly at all when slow. Near rest it rolls as without it.",
    references: &["Clift, Grace, Weber: Bubbles, Drops, and Particles, Academic Press, 1978, ch. 5"],
};

#[derive(Clone)]
pub(crate) struct QuadraticDrag<S: Simd> {
    coefficient: Lanes<S>,
}

impl<S: Simd> Effect<S> for QuadraticDrag<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            coefficient: values[0],
        }
    }

    /// Dividing by 1 + q |v| h is not only stable but the law's own solution.
    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let [wx, wy] = marbles.rolling();
        let way = (wx * wx + wy * wy).sqrt() * push.length;
        push.damping = push.damping.over(way.like(1.0) + self.coefficient * way);
    }
}
