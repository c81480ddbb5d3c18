//! Rows get longer or shorter in the course of a recording.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;

pub(super) const ABOUT: About = About {
    name: "clock_drift",
    stage: Stage::Timing,
    acts: Acts::OnClock,
    equation: "row length = nominal length × (1 + drift × part of the recording that has passed)",
    parameters: &[Parameter {
        name: "drift",
        unit: "",
        range: (-0.2, 0.2),
        neutral: 0.0,
        allowed: (-0.99, 10.0),
        means: "part by which the last row lasts longer than the first",
    }],
    does: "Each row lasts a little longer, or shorter, than the one before: a loop that slows down as its log grows, a clock that \
           warms up.",
    matters: "In long recordings without stamps; what adds up is half the drift of the whole duration.",
    looks: "An error of phase that begins at nothing and grows with the square of time, in bounces and coasting as in the answer \
            to commands.",
    references: &[
        "Mills: Computer Network Time Synchronization, CRC Press, 2006",
        "Allan: Time and frequency (time-domain) characterization, estimation, and prediction of precision clocks and \
         oscillators, IEEE Trans. UFFC 34(6), 1987",
    ],
};

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
