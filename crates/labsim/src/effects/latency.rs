//! A picture that is older than its row's time.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "latency",
    stage: Stage::Sensing,
    acts: Hook::OnExposure,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "seen(t) = marble(t - latency)",
    parameters: &[Parameter {
        name: "latency_s",
        unit: "s",
        range: (0.0, 0.3),
        neutral: 0.0,
        allowed: (0.0, 60.0),
        time_power: 1,
        optional: false,
        reach: None,
        means: "age of a picture when its row is written",
    }],
    does: "A row holds a position from some time ago, because exposure, transfer and detection take time. Row 0, from which a \
           rollout starts, is as old as the others: the marble is ahead of it by its velocity times this age.",
    matters: "Where the present position is needed, as in control, and where the command changes within the age of the \
              picture.",
    looks: "Every response is late by the same time. From positions that start at row 0 it cannot be distinguished from a \
            delay of the commands. The tilt in the picture distinguishes them, by parallax, and so does any event whose true \
            time is known.",
    references: &["Corke, Good: Dynamic effects in visual closed-loop systems, IEEE Trans. Robotics and Automation 12(5), 1996"],
};

#[derive(Clone)]
pub(crate) struct Latency<S: Simd> {
    latency: Lanes<S>,
}

impl<S: Simd> Effect<S> for Latency<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self { latency: values[0] }
    }

    fn age(&self) -> Option<Lanes<S>> {
        Some(self.latency)
    }
}
