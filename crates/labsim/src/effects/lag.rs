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
        time_power: 1,
        means: "time T in which the knob comes within 37 % of a step",
    }],
    does: "The knob creeps towards its command, the slower the nearer it is, as a position servo with a soft gain does.",
    matters: "When commands change within a few time constants.",
    looks: "Phase grows and amplitude falls with frequency. One slow sinusoid cannot tell it from a delay.",
    references: &["Åström, Murray: Feedback Systems, 2nd ed., sect. 6.3 (step response)"],
};

/// Part of a time constant below which an exponential is all rounding.
const SHORT: f64 = 1e-9;

#[derive(Clone)]
pub(crate) struct Lag<S: Simd> {
    time: Lanes<S>,
    knob: Option<Pair<S>>,
    step: Step<S>,
}

/// What a substep of this length leaves of the way to the command: at its end, and on average.
#[derive(Clone)]
struct Step<S: Simd> {
    length: Lanes<S>,
    at_end: Lanes<S>,
    on_average: Lanes<S>,
}

impl<S: Simd> Step<S> {
    #[inline(always)]
    fn new(time: Lanes<S>, length: Lanes<S>) -> Self {
        let (zero, one) = (time.like(0.0), time.like(1.0));
        let follows = time.gt(zero);
        let share = length.over(follows.select(time, one));
        let left = (-share).exp_decay();
        // A substep of no length leaves the knob where it is.
        let lasts = share.gt(SHORT * one);
        let on_average = lasts.select((one - left).over(lasts.select(share, one)), one);
        Self {
            length,
            at_end: follows.select(left, zero),
            on_average: follows.select(on_average, zero),
        }
    }
}

impl<S: Simd> Effect<S> for Lag<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            time: values[0],
            knob: None,
            step: Step::new(values[0], values[0].like(0.0)),
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
        let Some(turned) = &mut self.knob else {
            self.knob = Some(*knob);
            return;
        };
        if length.ne(self.step.length).any() {
            self.step = Step::new(self.time, length);
        }
        for (knob, turned) in knob.iter_mut().zip(turned) {
            let way = *turned - *knob;
            *turned = *knob + self.step.at_end * way;
            *knob = *knob + self.step.on_average * way;
        }
    }
}
