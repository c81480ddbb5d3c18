//! Rolling resistance that differs along the frame.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

/// Half the width over which the resistance passes from one to the other (m).
const HALF_RIM_M: f64 = 1e-3;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "frame_friction",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: false,
    shrunk: false,
    noise: None,
    equation: "resistance = rolling_friction g × factor where the marble is closer to the rim than width",
    parameters: &[
        Parameter {
            name: "width_m",
            unit: "m",
            range: (0.001, 0.03),
            neutral: 0.005,
            allowed: (0.0, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "distance from the rim to the marble's edge within which it acts; its onset is two millimetres wide",
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
    does: "Along the frame the marble rolls in a seam, over glue or dust, or rubs against the rim. There the rolling \
           resistance is multiplied by a factor, two to three on real boards.",
    matters: "In runs that follow the rim, which is where most mazes lead, and where marbles come to rest at it.",
    looks: "Marbles that roll along the rim slow down sooner than in the open, along all four sides and in both directions.",
    references: &[
        "Johnson: Contact Mechanics, Cambridge University Press, 1985, ch. 8 (rolling contact of elastic bodies)",
    ],
};

#[derive(Clone)]
pub(crate) struct FrameFriction<S: Simd> {
    /// Maximum distance of a marble's centre from the board's centre along x and y (m).
    reach_x: Lanes<S>,
    reach_y: Lanes<S>,
    width: Lanes<S>,
    /// factor - 1
    excess: Lanes<S>,
}

impl<S: Simd> Effect<S> for FrameFriction<S> {
    fn new(simd: S, rig: &Rig, values: &[Lanes<S>]) -> Self {
        let [reach_x, reach_y] = rig.reach_m();
        Self {
            reach_x: Lanes::splat(simd, reach_x),
            reach_y: Lanes::splat(simd, reach_y),
            width: values[0],
            excess: values[1] - values[1].like(1.0),
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let (zero, one) = (marbles.x.like(0.0), marbles.x.like(1.0));
        let (beside_x, beside_y) = (
            self.reach_x - marbles.x.abs(),
            self.reach_y - marbles.y.abs(),
        );
        let ahead = self.width - beside_x.min(beside_y);
        let inside = (0.5 / HALF_RIM_M * (ahead + one.like(HALF_RIM_M)))
            .max(zero)
            .min(one);
        push.resistance = push.resistance * (one + self.excess * inside);
    }
}
