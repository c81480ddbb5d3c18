//! Commands that each move both axes.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

const fn parameter(name: &'static str, means: &'static str) -> Parameter {
    Parameter {
        name,
        unit: "",
        range: (-0.1, 0.1),
        neutral: 0.0,
        allowed: (-10.0, 10.0),
        time_power: -2,
        optional: false,
        reach: None,
        means,
    }
}

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "gear_matrix",
    stage: Stage::Board,
    acts: Hook::OnTilt,
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "tilt_x = gear_x θ_x + a θ_y, tilt_y = gear_y θ_y + b θ_x",
    parameters: &[
        parameter(
            "x_from_y",
            "a, tilt about x (rad) per unit of the command about y",
        ),
        parameter(
            "y_from_x",
            "b, tilt about y (rad) per unit of the command about x",
        ),
    ],
    does: "The two commands do not drive the board's own axes: two motors at the corners, swapped cables, or a frame turned by \
           any angle. These parameters are the off-diagonal entries of a gear matrix. Its diagonal, gear_x and gear_y, may be \
           zero or of either sign.",
    matters: "Whenever one command alone tilts the board about both axes, or about the other axis.",
    looks: "Each command moves the marble along a direction of its own. Where a diagonal entry is zero, cross_coupling cannot \
            describe this, because it mixes commands that the gears have already scaled.",
    references: &["Skogestad, Postlethwaite: Multivariable Feedback Control, 2nd ed., Wiley, 2005, ch. 3"],
};

#[derive(Clone)]
pub(crate) struct GearMatrix<S: Simd> {
    x_from_y: Lanes<S>,
    y_from_x: Lanes<S>,
}

impl<S: Simd> Effect<S> for GearMatrix<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            x_from_y: values[0],
            y_from_x: values[1],
        }
    }

    #[inline(always)]
    fn tilt(&self, tilt: &mut Pair<S>, knob: &Pair<S>) {
        tilt[0] = tilt[0] + self.x_from_y * knob[1];
        tilt[1] = tilt[1] + self.y_from_x * knob[0];
    }
}
