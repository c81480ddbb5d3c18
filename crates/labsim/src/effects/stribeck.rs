//! Rolling resistance that falls with the speed.

use pulp::Simd;

use super::{Effect, EffectNoise, EffectSpec, Hook, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "stribeck",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: Some(EffectNoise::Release),
    equation: "resistance = rolling_friction g (1 + strength exp(-|v|/v_s))",
    parameters: &[
        Parameter {
            name: "strength",
            unit: "",
            range: (0.2, 3.0),
            neutral: 0.0,
            allowed: (0.0, 1e3),
            time_power: 0,
            optional: false,
            reach: None,
            means: "relative excess of the resistance near rest over that at speed",
        },
        Parameter {
            name: "speed_m_per_s",
            unit: "m/s",
            range: (0.005, 0.05),
            neutral: 0.02,
            allowed: (1e-6, 1e3),
            time_power: -1,
            optional: false,
            reach: None,
            means: "v_s, speed at which 37 % of the excess remain",
        },
    ],
    does: "Rolling resistance is higher at low speed than at high speed: a slow marble has time to sink into the surface or to \
           stick to it.",
    matters: "Near rest: in starts, and in the last centimetres before a stop. At three times v_s a twentieth of the excess \
              remains.",
    looks: "A coasting marble decelerates more and more and stops short. Starting takes more tilt than rolling on.",
    references: &[
        "Tustin: The effects of backlash and of speed-dependent friction on the stability of closed-cycle control systems, \
         J. IEE 94(2A), 1947",
        "Armstrong-Hélouvry, Dupont, Canudas de Wit: A survey of models, analysis tools and compensation methods for the control \
         of machines with friction, Automatica 30(7), 1994",
        "Olsson, Åström, Canudas de Wit, Gäfvert, Lischinsky: Friction models and friction compensation, European J. Control 4(3), 1998",
    ],
};

#[derive(Clone)]
pub(crate) struct Stribeck<S: Simd> {
    strength: Lanes<S>,
    /// 1/speed
    fall: Lanes<S>,
}

impl<S: Simd> Effect<S> for Stribeck<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let [strength, speed] = [values[0], values[1]];
        Self {
            strength,
            fall: speed.like(1.0).over(speed),
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let [wx, wy] = marbles.rolling();
        let left = (-((wx * wx + wy * wy).sqrt() * self.fall)).exp_decay();
        push.resistance = push.resistance * (left.like(1.0) + self.strength * left);
    }
}
