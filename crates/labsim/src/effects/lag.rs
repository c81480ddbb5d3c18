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

pub(crate) struct Lag<S: Simd> {
    time: Lanes<S>,
    knob: Option<Pair<S>>,
}

impl<S: Simd> Effect<S> for Lag<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            time: values[0],
            knob: None,
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
        let Some(mut turned) = self.knob else {
            self.knob = Some(*knob);
            return;
        };
        let follows = self.time.gt(self.time.like(0.0));
        let share = length.over(follows.select(self.time, self.time.like(1.0)));
        let left = (-share).exp_decay();
        // The average over the substep of what is left of the way to the command.
        let on_average = (left.like(1.0) - left).over(share.max(share.like(1e-12)));
        for (knob, turned) in knob.iter_mut().zip(&mut turned) {
            let way = *turned - *knob;
            *turned = follows.select(*knob + way * left, *knob);
            *knob = follows.select(*knob + way * on_average, *knob);
        }
        self.knob = Some(turned);
    }
}
