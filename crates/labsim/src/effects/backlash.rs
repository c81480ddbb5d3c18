//! Play between knob and board.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

const fn parameter(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        range: (0.001, 0.3),
        neutral: 0.0,
        allowed: (0.0, 1e6),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "backlash",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: false },
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "θ = min(max(θ before, command - width/2), command + width/2)",
    parameters: &[
        parameter(
            "width_x_rad",
            "turn of the knob about x after a reversal until the board follows",
        ),
        parameter(
            "width_y_rad",
            "turn of the knob about y after a reversal until the board follows",
        ),
    ],
    does: "After each reversal the knob turns through a gap before it moves the board: gears with clearance, or a cord that \
           slips on its pulley. At the start the board is in the middle of the gap.",
    matters: "Whenever the command reverses, the more the smaller its amplitude. A swing within the gap moves nothing.",
    looks: "After each reversal the board stands still over a fixed angle of the knob, at any speed; in between it trails by \
            half the gap. Tilt over command is a parallelogram.",
    references: &[
        "Nordin, Gutman: Controlling mechanical systems with backlash: a survey, Automatica 38, 2002",
        "Visintin: Differential Models of Hysteresis, Springer, 1994 (the play operator)",
    ],
};

#[derive(Clone)]
pub(crate) struct Backlash<S: Simd> {
    half_width: Pair<S>,
    knob: Option<Pair<S>>,
}

impl<S: Simd> Effect<S> for Backlash<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            half_width: [0.5 * values[0], 0.5 * values[1]],
            knob: None,
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        let before = self.knob.unwrap_or(*knob);
        for axis in 0..2 {
            let (low, high) = (
                knob[axis] - self.half_width[axis],
                knob[axis] + self.half_width[axis],
            );
            knob[axis] = before[axis].max(low).min(high);
        }
        self.knob = Some(*knob);
    }
}
