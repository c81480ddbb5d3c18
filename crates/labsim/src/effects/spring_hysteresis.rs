//! The cord gives before it takes the board along.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: About = About {
    name: "spring_hysteresis",
    stage: Stage::Actuation,
    acts: Acts::OnKnob { moves: false },
    equation: "θ = command - strength × z, dz/dcommand = 1 - sgn(dcommand) z/width",
    parameters: &[
        Parameter {
            name: "strength",
            unit: "",
            range: (0.0, 0.3),
            neutral: 0.0,
            allowed: (0.0, 1.0),
            means: "part of a small turn that the spring swallows",
        },
        Parameter {
            name: "width_rad",
            unit: "rad",
            range: (0.005, 0.2),
            neutral: 0.05,
            allowed: (1e-6, 10.0),
            means: "turn of the knob over which the spring lets go: 63 % of the way to its limit",
        },
    ],
    does: "The cord and its spring stretch before the pulley slides in them, and keep some of that stretch when the knob turns \
           back: the Bouc-Wen law of hysteresis, which knows angles but no time. At the start the cord is relaxed.",
    matters: "When the knob reverses often; what is missing tends to strength times width, so it is small amplitudes that suffer.",
    looks: "Tilt over command is a loop with rounded corners, and small swings make small loops inside the large one. Backlash \
            has sharp corners, lag a loop that widens with frequency.",
    references: &[
        "Wen: Method for random vibration of hysteretic systems, J. Engineering Mechanics Division ASCE 102(2), 1976",
        "Ismail, Ikhouane, Rodellar: The hysteresis Bouc-Wen model, a survey, Archives of Computational Methods in Engineering 16, 2009",
    ],
};

pub(crate) struct SpringHysteresis<S: Simd> {
    strength: Lanes<S>,
    width: Lanes<S>,
    /// What was commanded last and what the spring holds then (rad).
    before: Option<(Pair<S>, Pair<S>)>,
}

impl<S: Simd> Effect<S> for SpringHysteresis<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            strength: values[0],
            width: values[1],
            before: None,
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        let zero = self.width.like(0.0);
        let command = *knob;
        let (before, mut held) = self.before.unwrap_or((command, [zero; 2]));
        for axis in 0..2 {
            let way = command[axis] - before[axis];
            let limit = way.gt(zero).select(self.width, -self.width);
            let kept = (-(way.abs().over(self.width))).exp_decay();
            held[axis] = held[axis] + (limit - held[axis]) * (self.width.like(1.0) - kept);
            knob[axis] = command[axis] - self.strength * held[axis];
        }
        self.before = Some((command, held));
    }
}
