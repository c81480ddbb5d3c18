//! Rolling resistance that is lower along the grain of the wood than across it.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push, TINY};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "anisotropic_friction",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "resistance = rolling_friction g |(v_along, ratio × v_across)|/|v|, along and across the grain",
    parameters: &[
        Parameter {
            name: "ratio",
            unit: "",
            range: (1.0, 5.0),
            neutral: 1.0,
            allowed: (1.0, 1e4),
            time_power: 0,
            optional: false,
            reach: None,
            means: "resistance across the grain divided by that along it",
        },
        Parameter {
            name: "grain_rad",
            unit: "rad",
            range: (0.0, std::f64::consts::PI),
            neutral: 0.0,
            allowed: (-100.0, 100.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "angle from x to the grain, towards y",
        },
    ],
    does: "Rolling resistance is lower along the grain of the wood than across it, and always acts against the motion.",
    matters: "For slow marbles that coast at an angle to the grain, and for starts: across the grain they need more tilt.",
    looks: "Marbles coast farther along the grain than across it and start at less tilt. The same slope gives another path \
            after the board has been turned on its frame.",
    references: &[
        "Allevato, Short, Pryor, Thomaz: Iterative residual tuning for system identification and sim-to-real robot learning, 2020",
        "Zmitrowicz: Models of kinematics dependent anisotropic and heterogeneous friction, Int. J. Solids and Structures 43, 2006",
    ],
};

#[derive(Clone)]
pub(crate) struct AnisotropicFriction<S: Simd> {
    /// ratio² - 1
    excess: Lanes<S>,
    cos: Lanes<S>,
    sin: Lanes<S>,
}

impl<S: Simd> Effect<S> for AnisotropicFriction<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let (sin, cos) = values[1].sin_cos_of_any();
        Self {
            excess: values[0] * values[0] - values[0].like(1.0),
            cos,
            sin,
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let [wx, wy] = marbles.rolling();
        let (wx, wy) = (wx + 5.0 / 7.0 * push.x, wy + 5.0 / 7.0 * push.y);
        let across = self.cos * wy - self.sin * wx;
        let share = (across * across).over(wx * wx + wy * wy + wx.like(TINY));
        push.resistance = push.resistance * (wx.like(1.0) + self.excess * share).sqrt();
    }
}
