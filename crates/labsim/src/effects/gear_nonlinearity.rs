//! A gear ratio that depends on the angle.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage, by_axis};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "gear_nonlinearity",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: false },
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "tilt = gear × (θ + b θ³)",
    parameters: &[
        Parameter {
            name: "cubic_per_rad2",
            unit: "1/rad²",
            range: (-60.0, 60.0),
            neutral: 0.0,
            allowed: (-1e4, 1e4),
            time_power: 0,
            optional: false,
            reach: None,
            means: "b, relative change of the gear ratio per squared knob angle; mean of both axes",
        },
        Parameter::y_minus_x("y_minus_x_per_rad2", "1/rad²", 60.0, 2e4, 0),
    ],
    does: "The gear ratio changes with the size of the turn, alike on both sides: cords that wind up, lever arms that turn \
           away.",
    matters: "With large amplitudes: at a tenth of a radian, the ends of the range change the tilt by 60 %.",
    looks: "The gain depends on the amplitude. A sinusoid gains its third harmonic at any frequency; there is no memory.",
    references: &["Ljung: System Identification, 2nd ed., sect. 5.2 (models with nonlinearities)"],
};

#[derive(Clone)]
pub(crate) struct GearNonlinearity<S: Simd> {
    cubic: Pair<S>,
}

impl<S: Simd> Effect<S> for GearNonlinearity<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            cubic: by_axis(values[0], values[1]),
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        for (knob, &cubic) in knob.iter_mut().zip(&self.cubic) {
            *knob = *knob + *knob * (cubic * (*knob * *knob));
        }
    }
}
