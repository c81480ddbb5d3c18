//! A force across the direction of motion.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "side_force",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "acceleration = k ẑ × w, w the rolling velocity",
    parameters: &[Parameter {
        name: "rate_per_s",
        unit: "1/s",
        range: (-1.0, 1.0),
        neutral: 0.0,
        allowed: (-100.0, 100.0),
        time_power: -1,
        optional: false,
        reach: None,
        means: "k, angle by which the velocity turns per second; positive to the left",
    }],
    does: "A force across the motion, proportional to the speed, as spin about the vertical causes through contact and air. It \
           does no work.",
    matters: "On long runs: the direction is off by the rate times the time.",
    looks: "All paths curve to the same side, left or right, at any place and any speed. A coasting marble runs in a circle of \
            radius v/k. A board that is not level bends paths towards one side of the room instead.",
    references: &[
        "Johnson: Contact Mechanics, Cambridge University Press, 1985, ch. 8 (rolling contact of elastic bodies)",
        "Rubinow, Keller: The transverse force on a spinning sphere moving in a viscous fluid, J. Fluid Mechanics 11, 1961",
    ],
};

#[derive(Clone)]
pub(crate) struct SideForce<S: Simd> {
    rate: Lanes<S>,
}

impl<S: Simd> Effect<S> for SideForce<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self { rate: values[0] }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        // Cayley's form of a rotation keeps the length of the velocity: (2 a J - 2 a²)/(1 + a²), a = k h/2.
        let half = 0.5 * (self.rate * push.length);
        let part = (2.8 * half).over(half.like(1.0) + half * half);
        let [wx, wy] = marbles.rolling();
        push.x = push.x - part * (wy + half * wx);
        push.y = push.y + part * (wx - half * wy);
    }
}
