//! A disc of the board with another rolling resistance.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

/// Half the width of the rim of the patch, over which the resistance passes from one to the other (m).
const HALF_RIM_M: f64 = 1e-3;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "friction_patch",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "resistance = rolling_friction g × factor where |position - place| < radius",
    parameters: &[
        Parameter::on_board("x_m", 0.138, "its centre along x"),
        Parameter::on_board("y_m", 0.1155, "its centre along y"),
        Parameter {
            name: "radius_m",
            unit: "m",
            range: (0.01, 0.08),
            neutral: 0.04,
            allowed: (HALF_RIM_M, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "its radius; its edge is two millimetres wide",
        },
        Parameter {
            name: "factor",
            unit: "",
            range: (0.2, 8.0),
            neutral: 1.0,
            allowed: (0.0, 1e4),
            time_power: 0,
            optional: false,
            reach: None,
            means: "resistance there divided by that elsewhere",
        },
    ],
    does: "One place of the board is rougher, softer, dusty or polished. There the rolling resistance is multiplied by a \
           factor.",
    matters: "In runs that pass the place, most in slow ones, and where marbles come to rest.",
    looks: "Local, repeatable and always against the motion. Runs that pass it in opposite directions lose the same speed, \
            whereas a bump returns what it took. Marbles stop there.",
    references: &[
        "Tabor: The mechanism of rolling friction II. The elastic range, Proc. Royal Society A 229, 1955",
        "Johnson: Contact Mechanics, Cambridge University Press, 1985, ch. 9 (rolling contact of inelastic bodies)",
    ],
};

#[derive(Clone)]
pub(crate) struct FrictionPatch<S: Simd> {
    x: Lanes<S>,
    y: Lanes<S>,
    /// Square of the outer radius of the edge, and one over its difference to the square of the inner radius.
    end: Lanes<S>,
    steepness: Lanes<S>,
    /// factor - 1
    excess: Lanes<S>,
}

impl<S: Simd> Effect<S> for FrictionPatch<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let [x, y, radius, factor] = [values[0], values[1], values[2], values[3]];
        let outer = radius + radius.like(HALF_RIM_M);
        Self {
            x,
            y,
            end: outer * outer,
            steepness: radius.like(1.0).over(4.0 * HALF_RIM_M * radius),
            excess: factor - factor.like(1.0),
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (dx, dy) = (marbles.x - self.x, marbles.y - self.y);
        let (zero, one) = (dx.like(0.0), dx.like(1.0));
        let inside = (self.steepness * (self.end - (dx * dx + dy * dy)))
            .max(zero)
            .min(one);
        push.resistance = push.resistance * (one + self.excess * inside);
    }
}
