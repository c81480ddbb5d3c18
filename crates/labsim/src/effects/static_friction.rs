//! Break-away resistance of a marble at rest.

use pulp::Simd;

use super::{Effect, EffectNoise, EffectSpec, Hook, Memory, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::{Marbles, Push};

/// Speed along either axis below which a marble is at rest (m/s).
const REST: f64 = 1e-6;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "static_friction",
    stage: Stage::Contact,
    acts: Hook::OnMarble(Memory::None),
    hypothesis: true,
    shrunk: false,
    noise: Some(EffectNoise::Release),
    equation: "resistance = rolling_friction g × (1 + (ratio - 1)(1 - exp(-rest/rest_time)) at rest, 1 in motion)",
    parameters: &[
        Parameter {
            name: "ratio",
            unit: "",
            range: (1.0, 5.0),
            neutral: 1.0,
            allowed: (1.0, 1e4),
            time_power: 0,
            optional: false,
            reach: Some((1.0, 8.0)),
            means: "tilt at which a long rested marble breaks away, divided by the tilt that keeps it rolling",
        },
        Parameter {
            name: "rest_time_s",
            unit: "s",
            range: (0.0, 2.0),
            neutral: 0.0,
            allowed: (0.0, 1e3),
            time_power: 1,
            optional: true,
            reach: None,
            means: "time constant with which the break-away tilt rises during rest; at 0 it rises at once",
        },
    ],
    does: "A marble at rest needs more tilt to start than a rolling one needs to roll on. It has settled into the surface, the \
           deeper the longer it rests. The instant of rest at a reversal counts too.",
    matters: "Around stops and reversals, while the tilt is near the rolling resistance. Fast runs are not affected.",
    looks: "Late starts after rests, then a jump. A slow drive back and forth moves the marble in jerks (stick-slip). Coasting \
            does not change.",
    references: &[
        "Karnopp: Computer simulation of stick-slip friction in mechanical dynamic systems, J. Dynamic Systems, Measurement, \
         and Control 107(1), 1985",
        "Armstrong-Hélouvry, Dupont, Canudas de Wit: A survey of models, analysis tools and compensation methods for the control \
         of machines with friction, Automatica 30(7), 1994",
    ],
};

#[derive(Clone)]
pub(crate) struct StaticFriction<S: Simd> {
    ratio: Lanes<S>,
    rest_time: Lanes<S>,
    /// Whether the break-away tilt grows with the time at rest in some lane.
    grows: bool,
    /// Time at rest (s); infinite before the release.
    rested: Lanes<S>,
}

impl<S: Simd> Effect<S> for StaticFriction<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let [ratio, rest_time] = [values[0], values[1]];
        Self {
            ratio,
            rest_time,
            grows: rest_time.gt(rest_time.like(0.0)).any(),
            rested: ratio.like(f64::INFINITY),
        }
    }

    #[inline(always)]
    fn act(&mut self, marbles: &Marbles<S>, push: &mut Push<S>) {
        let [wx, wy] = marbles.rolling();
        let rest = wx.like(REST);
        let still = wx.abs().lt(rest) & wy.abs().lt(rest);
        // A marble that reverses is at rest in between, even if only within a substep.
        let (ahead_x, ahead_y) = (wx + 5.0 / 7.0 * push.x, wy + 5.0 / 7.0 * push.y);
        let turns = (wx * ahead_x + wy * ahead_y).le(wx.like(0.0));
        let (zero, one) = (wx.like(0.0), wx.like(1.0));
        let mut at_rest = self.ratio;
        if self.grows {
            self.rested = still.select(self.rested, zero);
            let grows = self.rest_time.gt(zero);
            let share = self.rested.over(grows.select(self.rest_time, one));
            let grown = one + (self.ratio - one) * (one - (-share).exp_decay());
            at_rest = grows.select(grown, self.ratio);
            self.rested = self.rested + push.length;
        }
        let ratio = (still | turns).select(at_rest, one);
        push.resistance = push.resistance * ratio;
    }
}
