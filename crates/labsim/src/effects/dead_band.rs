//! A range of small commands that the board does not follow.

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
    noise: None,
    equation: "knob = command - clamp(command, -b, b)",
    parameters: &[
        Parameter {
            name: "half_width_rad",
            unit: "rad",
            range: (0.005, 0.15),
            neutral: 0.0,
            allowed: (0.0, 1e6),
            time_power: 0,
            optional: false,
            reach: None,
            means: "b, half width of the band about zero in which the board stays level; mean of both axes",
        },
        Parameter::y_minus_x("y_minus_x_rad", "rad", 0.1, 2e6, 0),
    ],
    does: "Around zero the knob turns without moving the board. Outside this band the board follows, offset by the band's half \
           width. Causes are a slack cord with springs that hold the board level, or a controller that ignores small errors.",
    matters: "When commands are not much larger than the band: commands of twice its half width lose half of their effect.",
    looks: "The tilt is too small by a fixed angle, and zero within the band, alike for rising and falling commands. There is \
            no memory, unlike with backlash.",
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
