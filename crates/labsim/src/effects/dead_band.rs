//! Small commands have no answer.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: About = About {
    name: "dead_band",
    stage: Stage::Actuation,
    acts: Acts::OnKnob { moves: false },
    equation: "knob = command - clamp(command, -b, b)",
    parameters: &[Parameter {
        name: "half_width_rad",
        unit: "rad",
        range: (0.005, 0.15),
        neutral: 0.0,
        allowed: (0.0, 10.0),
        time_power: 0,
        means: "b, the angle on either side of zero within which the board stays level",
    }],
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
    half_width: Lanes<S>,
}

impl<S: Simd> Effect<S> for DeadBand<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            half_width: values[0],
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        for knob in knob {
            *knob = *knob - knob.clamp(self.half_width);
        }
    }
}
