//! A first-order lag of the knob.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage, by_axis};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "lag",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: true },
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "T dθ/dt = command - θ",
    parameters: &[
        Parameter {
            name: "time_constant_s",
            unit: "s",
            range: (0.02, 1.0),
            neutral: 0.0,
            allowed: (0.0, 1e3),
            time_power: 1,
            optional: false,
            reach: None,
            means: "T, time constant: after T the knob still lacks 37 % of a step; mean of both axes",
        },
        Parameter::y_minus_x("y_minus_x_s", "s", 0.5, 2e3, 1),
    ],
    does: "The knob approaches its command exponentially, as a position servo with a low gain does.",
    matters: "When commands change within a few time constants.",
    looks: "Phase lag grows and amplitude falls with frequency. A single slow sinusoid does not distinguish it from a delay.",
    references: &["Åström, Murray: Feedback Systems, 2nd ed., sect. 6.3 (step response)"],
};

/// Substep over time constant below which an exponential is dominated by rounding.
const SHORT: f64 = 1e-9;

#[derive(Clone)]
pub(crate) struct Lag<S: Simd> {
    time: Pair<S>,
    knob: Option<Pair<S>>,
    /// Length of the substep that the steps are for.
    length: Lanes<S>,
    steps: [Step<S>; 2],
}

/// Share of the distance to the command that remains after a substep: at its end, and on average.
#[derive(Clone)]
struct Step<S: Simd> {
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
        // A substep of zero length does not move the knob.
        let lasts = share.gt(SHORT * one);
        let on_average = lasts.select((one - left).over(lasts.select(share, one)), one);
        Self {
            at_end: follows.select(left, zero),
            on_average: follows.select(on_average, zero),
        }
    }
}

impl<S: Simd> Effect<S> for Lag<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let zero = values[0].like(0.0);
        let time = by_axis(values[0], values[1]).map(|time| time.max(zero));
        Self {
            time,
            knob: None,
            length: zero,
            steps: time.map(|time| Step::new(time, zero)),
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
        let Some(turned) = &mut self.knob else {
            self.knob = Some(*knob);
            return;
        };
        if length.ne(self.length).any() {
            self.length = length;
            self.steps = self.time.map(|time| Step::new(time, length));
        }
        for ((knob, turned), step) in knob.iter_mut().zip(turned).zip(&self.steps) {
            let way = *turned - *knob;
            *turned = *knob + step.at_end * way;
            *knob = *knob + step.on_average * way;
        }
    }
}
