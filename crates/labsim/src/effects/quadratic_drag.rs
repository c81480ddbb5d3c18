//! Drag that is proportional to the square of the speed.

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
    noise: None,
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
        means: "q, part of the velocity that is lost per metre of the path",
    }],
    does: "The marble loses a fixed part of its velocity per metre to the air that it displaces. For a steel marble the \
           coefficient is some thousandths of 1/m. A much larger fitted value stands for another loss.",
    matters: "At high speed only: half the speed brakes a quarter as much.",
    looks: "A coasting marble slows down as v/(1 + q v t): fast at first, hardly at all when slow. Near rest nothing changes.",
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

    /// Dividing by 1 + q |v| h is stable, and is the exact solution of the law.
    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let [wx, wy] = marbles.rolling();
        let way = (wx * wx + wy * wy).sqrt() * push.length;
        push.damping = push.damping.over(way.like(1.0) + self.coefficient * way);
    }
}
