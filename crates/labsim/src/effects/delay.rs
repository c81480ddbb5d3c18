//! A constant delay of all commands.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage, by_axis};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "delay",
    stage: Stage::Actuation,
    acts: Hook::OnArrival,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "knob(t) = command(t - delay)",
    parameters: &[
        Parameter {
            name: "delay_s",
            unit: "s",
            range: (0.0, 0.6),
            neutral: 0.0,
            allowed: (0.0, 60.0),
            time_power: 1,
            optional: false,
            reach: None,
            means: "time from a command to the knob's response; mean of both axes",
        },
        Parameter::y_minus_x("y_minus_x_s", "s", 0.3, 120.0, 1),
    ],
    does: "Networks, controllers and drives pass commands on with a constant dead time. The board answers every command late \
           by that time.",
    matters: "Whenever the command changes within the delay. A slow sinusoid hides a delay as a phase shift.",
    looks: "A pure time shift of every response to the commands. Steps, or several frequencies, distinguish it from a lag. A \
            camera with latency looks the same, unless its picture shows the tilt itself.",
    references: &[
        "Allevato, Short, Pryor, Thomaz: Iterative residual tuning for system identification and sim-to-real robot learning, 2020",
        "Åström, Murray: Feedback Systems, 2nd ed., sect. 10.2 (time delays)",
    ],
};

#[derive(Clone)]
pub(crate) struct Delay<S: Simd> {
    delay: Pair<S>,
}

impl<S: Simd> Effect<S> for Delay<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let delay = by_axis(values[0], values[1]);
        Self {
            delay: delay.map(|delay| delay.max(delay.like(0.0))),
        }
    }

    fn late(&self, _: impl FnMut() -> Lanes<S>) -> Option<Pair<S>> {
        Some(self.delay)
    }
}
