//! Rolling along the grain of the wood is easier than across it.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

/// Keeps one over a speed of zero finite; the square of a speed (m/s) far below any that matters.
const TINY: f64 = 1e-280;

pub(super) const ABOUT: About = About {
    name: "anisotropic_friction",
    stage: Stage::Contact,
    acts: Acts::OnMarble,
    equation: "resistance = rolling_friction g (v_along + ratio × v_across)/|v|, along and across the grain",
    parameters: &[
        Parameter {
            name: "ratio",
            unit: "",
            range: (1.0, 5.0),
            neutral: 1.0,
            allowed: (1.0, 1e4),
            means: "resistance across the grain over that along it",
        },
        Parameter {
            name: "grain_rad",
            unit: "rad",
            range: (0.0, std::f64::consts::PI),
            neutral: 0.0,
            allowed: (-100.0, 100.0),
            means: "angle from x to the grain, towards y",
        },
    ],
    does: "The grain of the wood lets the marble roll along it and brakes it across it.",
    matters: "For slow marbles that coast at an angle to the grain, and for starts: across the grain they need more tilt.",
    looks: "Coasting paths bend towards the grain, and marbles run out farther along it than across it.",
    references: &[
        "Allevato, Short, Pryor, Thomaz: Iterative residual tuning for system identification and sim-to-real robot learning, 2020",
        "Zmitrowicz: Models of kinematics dependent anisotropic and heterogeneous friction, Int. J. Solids and Structures 43, 2006",
    ],
};

pub(crate) struct AnisotropicFriction<S: Simd> {
    /// ratio - 1
    excess: Lanes<S>,
    cos: Lanes<S>,
    sin: Lanes<S>,
}

impl<S: Simd> Effect<S> for AnisotropicFriction<S> {
    fn new(simd: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let grain = values[1].to_array();
        Self {
            excess: values[0] - values[0].like(1.0),
            cos: Lanes::from_fn(simd, |lane| libm::cos(grain[lane])),
            sin: Lanes::from_fn(simd, |lane| libm::sin(grain[lane])),
        }
    }

    /// What the resistance takes beyond that of the grain: the engine takes the same in all directions.
    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let [wx, wy] = marbles.rolling();
        let (wx, wy) = (wx + 5.0 / 7.0 * push.x, wy + 5.0 / 7.0 * push.y);
        let across = self.cos * wy - self.sin * wx;
        let speed = (wx * wx + wy * wy + wx.like(TINY)).sqrt();
        // Never more than there is; so a marble whose push is below the resistance across stays at rest.
        let part = (self.excess * push.resistance.over(speed)).min(wx.like(1.0));
        let taken = 1.4 * (part * across);
        push.x = push.x + taken * self.sin;
        push.y = push.y - taken * self.cos;
    }
}
