//! The picture is older than its row says.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;

pub(super) const ABOUT: About = About {
    name: "latency",
    stage: Stage::Sensing,
    acts: Acts::OnExposure,
    equation: "seen(t) = marble(t - latency)",
    parameters: &[Parameter {
        name: "latency_s",
        unit: "s",
        range: (0.0, 0.3),
        neutral: 0.0,
        allowed: (0.0, 60.0),
        means: "age of a picture when its row is written",
    }],
    does: "A row tells where the marble was some time ago: exposure, transfer and search in the picture take that long. Row 0, \
           from which a rollout starts, is as old as the others.",
    matters: "For fast marbles: the error is the speed times the age.",
    looks: "Everything is shifted in time, coasting and bounces too, which a delay of the commands leaves where they are.",
    references: &["Corke, Good: Dynamic effects in visual closed-loop systems, IEEE Trans. Robotics and Automation 12(5), 1996"],
};

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
