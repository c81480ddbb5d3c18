//! Knobs that also tilt the board about the other axis.

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
        allowed: (-10.0, 10.0),
        time_power: 0,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "cross_coupling",
    stage: Stage::Board,
    acts: Hook::OnTilt,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "tilt_x = gear_x knob_x + a gear_y knob_y, tilt_y = gear_y knob_y + b gear_x knob_x",
    parameters: &[
        parameter(
            "x_from_y",
            "a, tilt about x per radian of tilt that the y knob causes",
        ),
        parameter(
            "y_from_x",
            "b, tilt about y per radian of tilt that the x knob causes",
        ),
    ],
    does: "Each knob also tilts the board about the other axis: axes that are not square to the frame, or a gimbal that \
           twists. Opposite values of the two parameters rotate the axes, by 17 degrees at 0.3.",
    matters: "As soon as one knob moves while the other rests, or the two move at different times.",
    looks: "When only the knob about x moves, which should roll the marble along y, the marble also moves along x, in the \
            shape of that command.",
    references: &["Skogestad, Postlethwaite: Multivariable Feedback Control, 2nd ed., Wiley, 2005, ch. 3"],
};

#[derive(Clone)]
pub(crate) struct CrossCoupling<S: Simd> {
    x_from_y: Lanes<S>,
    y_from_x: Lanes<S>,
}

impl<S: Simd> Effect<S> for CrossCoupling<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            x_from_y: values[0],
            y_from_x: values[1],
        }
    }

    #[inline(always)]
    fn tilt(&self, tilt: &mut Pair<S>, _: &Pair<S>) {
        *tilt = [
            tilt[0] + self.x_from_y * tilt[1],
            tilt[1] + self.y_from_x * tilt[0],
        ];
    }
}
