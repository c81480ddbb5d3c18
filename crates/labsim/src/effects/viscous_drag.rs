//! Drag that is proportional to the speed.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "viscous_drag",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "dv/dt = -c v",
    parameters: &[Parameter {
        name: "rate_per_s",
        unit: "1/s",
        range: (0.0, 2.0),
        neutral: 0.0,
        allowed: (0.0, 1e3),
        time_power: -1,
        optional: false,
        reach: None,
        means: "c, part of the velocity that is lost per second",
    }],
    does: "The marble loses a fixed part of its velocity and spin per second, as on felt, rubber or a film of oil.",
    matters: "For fast marbles and long runs: above the speed rolling_friction g/c, drag exceeds rolling resistance.",
    looks: "The speed of a coasting marble decays exponentially and would never reach zero. The response to the drive shifts \
            in phase, as with a lag, but coasting reveals the drag.",
    references: &[
        "Olsson, Åström, Canudas de Wit, Gäfvert, Lischinsky: Friction models and friction compensation, European J. Control 4(3), 1998",
        "Landau, Lifshitz: Fluid Mechanics, 2nd ed., § 20 (Stokes' formula)",
    ],
};

#[derive(Clone)]
pub(crate) struct ViscousDrag<S: Simd> {
    rate: Lanes<S>,
}

impl<S: Simd> Effect<S> for ViscousDrag<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self { rate: values[0] }
    }

    #[inline(always)]
    fn act(&mut self, _: &Marbles<S>, push: &mut Push<S>) {
        let one = push.length.like(1.0);
        push.damping = push.damping.over(one + self.rate * push.length);
    }
}
