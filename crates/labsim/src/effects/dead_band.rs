//! Small commands have no answer.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage, by_axis};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "dead_band",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: false },
    hypothesis: true,
    shrunk: false,
    equation: "knob = command - clamp(command, -b, b)",
    parameters: &[
        Parameter {
            name: "half_width_rad",
            unit: "rad",
            range: (0.005, 0.15),
            neutral: 0.0,
            allowed: (0.0, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "b, the angle on either side of zero within which the board stays level, the mean of both axes",
        },
        Parameter::y_minus_x("y_minus_x_rad", "rad", 0.1, 20.0, 0),
    ],
    does: "About zero the knob turns without moving the board, beyond that the board follows by so much less: a slack cord \
           with springs that hold the board level, or a controller that ignores small errors.",
    matters: "When commands are not much larger than the band; half the drive is lost where they are twice as large.",
    looks: "Drive is missing about zero, by a fixed angle beyond it, and the same way up and down: no memory, which a backlash has.",
    references: &[
        "Slotine, Li: Applied Nonlinear Control, Prentice Hall, 1991, sect. 5.2 (common nonlinearities)",
        "Tao, Kokotović: Adaptive Control of Systems with Actuator and Sensor Nonlinearities, Wiley, 1996",
    ],
};

#[derive(Clone)]
pub(crate) struct DeadBand<S: Simd> {
    half_width: Pair<S>,
}

impl<S: Simd> Effect<S> for DeadBand<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let half_width = by_axis(values[0], values[1]);
        Self {
            half_width: half_width.map(|width| width.max(width.like(0.0))),
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        for (knob, &half_width) in knob.iter_mut().zip(&self.half_width) {
            *knob = *knob - knob.clamp(half_width);
        }
    }
}
