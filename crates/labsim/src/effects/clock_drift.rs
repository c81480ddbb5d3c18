//! A camera clock that drifts from the clock of the commands.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "clock_drift",
    stage: Stage::Timing,
    acts: Hook::OnClock,
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "row length = command length × (1 + drift (part of the recording that has passed - 1/2))",
    parameters: &[Parameter {
        name: "drift",
        unit: "",
        range: (-0.2, 0.2),
        neutral: 0.0,
        allowed: (-0.99, 10.0),
        time_power: 0,
        optional: false,
        reach: None,
        means: "(last row length - first row length) / mean row length",
    }],
    does: "One clock issues the commands, another triggers the pictures, and its rate changes in the course of a recording: a \
           clock that warms up, or a loop that slows down as its log grows. On average the two agree.",
    matters: "In recordings without time stamps. The timing error is greatest in the middle, an eighth of the drift times the \
              whole duration, and zero at both ends.",
    looks: "A phase error that grows towards the middle of a recording and vanishes again, in bounces and coasting as well as \
            in responses to commands.",
    references: &[
        "Mills: Computer Network Time Synchronization, CRC Press, 2006",
        "Allan: Time and frequency (time-domain) characterization, estimation, and prediction of precision clocks and \
         oscillators, IEEE Trans. UFFC 34(6), 1987",
    ],
};

#[derive(Clone)]
pub(crate) struct ClockDrift<S: Simd> {
    drift: Lanes<S>,
}

impl<S: Simd> Effect<S> for ClockDrift<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self { drift: values[0] }
    }

    #[inline(always)]
    fn pace(&self, part: Lanes<S>) -> Lanes<S> {
        part.like(1.0) + self.drift * part
    }
}
