//! A straight strip of the board with another rolling resistance.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

/// Half the width of an edge of the strip, over which the resistance passes from one to the other (m).
const HALF_RIM_M: f64 = 1e-3;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "friction_strip",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "resistance = rolling_friction g × factor where |y cos(angle) - x sin(angle) - offset| < width/2",
    parameters: &[
        Parameter::on_board(
            "offset_m",
            0.138,
            "distance of the strip's centre line from the board's centre, to the left of its direction",
        ),
        Parameter {
            name: "angle_rad",
            unit: "rad",
            range: (0.0, std::f64::consts::PI),
            neutral: 0.0,
            allowed: (-100.0, 100.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "angle from x to the strip's direction, towards y",
        },
        Parameter {
            name: "width_m",
            unit: "m",
            range: (0.005, 0.08),
            neutral: 0.02,
            allowed: (0.0, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "its width; each edge is two millimetres wide",
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
    does: "A strip of tape, a seam or a worn track crosses the board. On it the rolling resistance is multiplied by a factor.",
    matters: "In runs that cross it, most in slow ones and in those that roll along it.",
    looks: "Runs lose speed where they cross one line, equally in both directions. Marbles come to rest on it.",
    references: &[
        "Tabor: The mechanism of rolling friction II. The elastic range, Proc. Royal Society A 229, 1955",
        "Johnson: Contact Mechanics, Cambridge University Press, 1985, ch. 9 (rolling contact of inelastic bodies)",
    ],
};

#[derive(Clone)]
pub(crate) struct FrictionStrip<S: Simd> {
    sin: Lanes<S>,
    cos: Lanes<S>,
    offset: Lanes<S>,
    half_width: Lanes<S>,
    /// factor - 1
    excess: Lanes<S>,
}

impl<S: Simd> Effect<S> for FrictionStrip<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let (sin, cos) = values[1].sin_cos_of_any();
        Self {
            sin,
            cos,
            offset: values[0],
            half_width: 0.5 * values[2],
            excess: values[3] - values[3].like(1.0),
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (zero, one) = (marbles.x.like(0.0), marbles.x.like(1.0));
        let beside = self.cos * marbles.y - self.sin * marbles.x - self.offset;
        let ahead = self.half_width - beside.abs();
        let inside = (0.5 / HALF_RIM_M * (ahead + one.like(HALF_RIM_M)))
            .max(zero)
            .min(one);
        push.resistance = push.resistance * (one + self.excess * inside);
    }
}
