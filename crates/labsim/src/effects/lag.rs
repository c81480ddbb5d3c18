//! The knob follows its command like a first-order servo.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: About = About {
    name: "lag",
    stage: Stage::Actuation,
    acts: Acts::OnKnob { moves: true },
    equation: "T dθ/dt = command - θ",
    parameters: &[Parameter {
        name: "time_constant_s",
        unit: "s",
        range: (0.02, 1.0),
        neutral: 0.0,
        allowed: (0.0, 1e3),
        means: "time T in which the knob comes within 37 % of a step",
    }],
    does: "The knob creeps towards its command, the slower the nearer it is, as a position servo with a soft gain does.",
    matters: "When commands change within a few time constants.",
    looks: "Phase grows and amplitude falls with frequency. One slow sinusoid cannot tell it from a delay.",
    references: &["Åström, Murray: Feedback Systems, 2nd ed., sect. 6.3 (step response)"],
};

/// Shares of a time constant below this leave the knob where it is: their exponential is all rounding.
const SHORT: f64 = 1e-9;

pub(crate) struct Lag<S: Simd> {
    time: Lanes<S>,
    knob: Option<Pair<S>>,
    /// Length of a substep (s), what it leaves of the way to the command, and what is left on average.
    length: Lanes<S>,
    left: Lanes<S>,
    on_average: Lanes<S>,
}

impl<S: Simd> Effect<S> for Lag<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let time = values[0];
        Self {
            time,
            knob: None,
            length: time.like(0.0),
            left: time.like(1.0),
            on_average: time.like(1.0),
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
        let Some(mut turned) = self.knob else {
            self.knob = Some(*knob);
            return;
        };
        if (length.lt(self.length) | length.gt(self.length)).any() {
            self.measure(length);
        }
        let follows = self.time.gt(self.time.like(0.0));
        for (knob, turned) in knob.iter_mut().zip(&mut turned) {
            let way = *turned - *knob;
            *turned = follows.select(*knob + way * self.left, *knob);
            *knob = follows.select(*knob + way * self.on_average, *knob);
        }
        self.knob = Some(turned);
    }
}

impl<S: Simd> Lag<S> {
    /// Substeps are alike for a row and longer: their exponential is worth keeping.
    fn measure(&mut self, length: Lanes<S>) {
        let one = length.like(1.0);
        let follows = self.time.gt(self.time.like(0.0));
        let share = length.over(follows.select(self.time, one));
        let lasts = share.gt(share.like(SHORT));
        let left = (-share).exp_decay();
        let on_average = (one - left).over(lasts.select(share, one));
        self.length = length;
        self.left = lasts.select(left, one);
        self.on_average = lasts.select(on_average, one);
    }
}
