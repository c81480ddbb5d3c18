//! A delay that varies from command to command.

use pulp::Simd;

use super::{Effect, EffectNoise, EffectSpec, Hook, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "delay_jitter",
    stage: Stage::Timing,
    acts: Hook::OnArrival,
    hypothesis: true,
    shrunk: false,
    noise: Some(EffectNoise::Jitter),
    equation: "knob(t + late_i) = command_i, late_i = max(0, delay + sd × N(0, 1))",
    parameters: &[Parameter {
        name: "sd_s",
        unit: "s",
        range: (0.005, 0.2),
        neutral: 0.0,
        allowed: (0.0, 60.0),
        time_power: 1,
        optional: false,
        reach: None,
        means: "standard deviation of a command's delay about its mean",
    }],
    does: "The transport delay differs from command to command, as on a shared network or in a controller without a clock of \
           its own. A command that a later one overtakes is dropped. No command arrives before it is sent.",
    matters: "When commands change fast: the error is the command's rate times the spread of the delays.",
    looks: "An error that grows with the command's rate and differs between repetitions of the same commands, so that no \
            simulation predicts it. Its mean over many runs is a short delay.",
    references: &["Nilsson: Real-Time Control Systems with Delays, PhD thesis, Lund Institute of Technology, 1998"],
};

#[derive(Clone)]
pub(crate) struct DelayJitter<S: Simd> {
    sd: Lanes<S>,
}

impl<S: Simd> Effect<S> for DelayJitter<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self { sd: values[0] }
    }

    fn late(&self, mut draw: impl FnMut() -> Lanes<S>) -> Option<Pair<S>> {
        Some([self.sd * draw(); 2])
    }
}
