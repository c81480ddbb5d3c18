//! A knob that moves in steps.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

/// Smaller steps (rad) are ignored: a command divided by them would not be finite.
const FINEST: f64 = 1e-12;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "command_quantisation",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: false },
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "knob = step × round(command/step)",
    parameters: &[Parameter {
        name: "step_rad",
        unit: "rad",
        range: (5e-4, 0.02),
        neutral: 0.0,
        allowed: (0.0, 1e6),
        time_power: 0,
        optional: false,
        reach: None,
        means: "smallest turn of the knob",
    }],
    does: "The knob stops only at multiples of a smallest turn: the resolution of a servo's encoder, of a stepper motor or of \
           a message with few digits.",
    matters: "When commands span only a few steps. Small amplitudes suffer most; below half a step nothing moves.",
    looks: "A staircase instead of a smooth tilt. Small commands are lost or rounded up, and a slow sinusoid gains harmonics.",
    references: &["Widrow, Kollár: Quantization Noise, Cambridge University Press, 2008"],
};

#[derive(Clone)]
pub(crate) struct CommandQuantisation<S: Simd> {
    step: Lanes<S>,
}

impl<S: Simd> Effect<S> for CommandQuantisation<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self { step: values[0] }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        let steps = self.step.gt(self.step.like(FINEST));
        let step = steps.select(self.step, self.step.like(1.0));
        for knob in knob {
            *knob = steps.select(step * knob.over(step).round(), *knob);
        }
    }
}
