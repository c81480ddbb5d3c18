//! A constant tilt of the board while the knobs are level.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

const fn parameter(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "rad",
        range: (-0.01, 0.01),
        neutral: 0.0,
        allowed: (-0.5, 0.5),
        time_power: -2,
        optional: false,
        reach: Some((-0.06, 0.06)),
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "tilt_bias",
    stage: Stage::Board,
    acts: Hook::OnTilt,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "tilt = gear × knob + bias",
    parameters: &[
        parameter("bias_x_rad", "tilt about x while the knobs are level"),
        parameter("bias_y_rad", "tilt about y while the knobs are level"),
    ],
    does: "The board is tilted while its knobs are level: the table is not level, or the knobs' zero is not the board's.",
    matters: "As soon as the bias is comparable to the rolling resistance; a milliradian is enough.",
    looks: "A constant push in one direction, which stays the same when the command is mirrored. A marble at rest may start to \
            creep.",
    references: &["Ljung: System Identification, 2nd ed., sect. 14.1 (offsets)"],
};

#[derive(Clone)]
pub(crate) struct TiltBias<S: Simd> {
    bias: Pair<S>,
}

impl<S: Simd> Effect<S> for TiltBias<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            bias: [values[0], values[1]],
        }
    }

    #[inline(always)]
    fn tilt(&self, tilt: &mut Pair<S>, _: &Pair<S>) {
        for (tilt, &bias) in tilt.iter_mut().zip(&self.bias) {
            *tilt = *tilt + bias;
        }
    }
}
