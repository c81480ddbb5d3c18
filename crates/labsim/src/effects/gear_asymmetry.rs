//! A gear ratio that differs between the two directions.

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
    noise: None,
    equation: "tilt = gear × (θ + a |θ|)",
    parameters: &[
        parameter(
            "asymmetry_x",
            "a, relative increase of the tilt for positive turns about x, decrease for negative ones",
        ),
        parameter(
            "asymmetry_y",
            "a, relative increase of the tilt for positive turns about y, decrease for negative ones",
        ),
    ],
    does: "A turn of the knob to one side tilts the board more than the same turn to the other side: springs of unequal \
           tension, or a lever that is not upright at zero.",
    matters: "Whenever the knob works on both sides of zero. Commands on one side alone only see another gear ratio.",
    looks: "The gain depends on the command's sign. Under a symmetric command the marble drifts to one side in proportion to \
            the amplitude. On a board that is not level the drift does not depend on the amplitude.",
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
