//! The gear ratio differs between the two directions.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

const fn parameter(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "",
        range: (-0.3, 0.3),
        neutral: 0.0,
        allowed: (-1.0, 1.0),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "gear_asymmetry",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: false },
    hypothesis: true,
    shrunk: false,
    equation: "tilt = gear × (θ + a |θ|)",
    parameters: &[
        parameter(
            "asymmetry_x",
            "part by which positive turns about x count more, negative ones less",
        ),
        parameter(
            "asymmetry_y",
            "part by which positive turns about y count more, negative ones less",
        ),
    ],
    does: "A turn of the knob to one side tilts the board more than the same turn to the other: springs of unequal tension, \
           a lever that does not stand upright at zero.",
    matters: "Whenever the knob works on both sides of zero; commands on one side only see another gear ratio and nothing else.",
    looks: "The gain depends on the sign of the command. A symmetric command makes the marble drift to one side, by an amount in \
            proportion to its amplitude, where a board that is not level drifts the same for all.",
    references: &["Ljung: System Identification, 2nd ed., sect. 5.2 (models with nonlinearities)"],
};

#[derive(Clone)]
pub(crate) struct GearAsymmetry<S: Simd> {
    asymmetry: Pair<S>,
}

impl<S: Simd> Effect<S> for GearAsymmetry<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            asymmetry: [values[0], values[1]],
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        for (knob, &asymmetry) in knob.iter_mut().zip(&self.asymmetry) {
            *knob = *knob + asymmetry * knob.abs();
        }
    }
}
