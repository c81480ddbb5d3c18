//! The cord's spring stores force and gives it back late.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::{Lanes, Mask};
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "spring_hysteresis",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: false },
    hypothesis: true,
    shrunk: false,
    equation: "θ = command + strength × z, dz = dcommand - (|dcommand| z + dcommand |z|)/(2 width): in one step a change if \
               the knob jumps, else along it",
    parameters: &[
        Parameter {
            name: "strength",
            unit: "",
            range: (-0.5, 1.5),
            neutral: 0.0,
            allowed: (-1.0, 100.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "what the spring adds to a small turn, as a part of it; negative where it swallows some",
        },
        Parameter {
            name: "width_rad",
            unit: "rad",
            range: (0.005, 0.2),
            neutral: 0.05,
            allowed: (1e-6, 10.0),
            time_power: 0,
            optional: false,
            reach: None,
            means: "stretch at which the spring gives way",
        },
        Parameter::choice(
            "jumps",
            1.0,
            "1 if each change of the command is one step of the law, as a simulator takes it; 0 if the knob passes through \
             all angles of a turn",
        ),
    ],
    does: "The cord and its spring are stretched with each turn, and pull the board farther than the knob alone would until they \
           give way at their width; on the way back they have to be let off first: the Bouc-Wen law of hysteresis, which knows \
           angles but no time. At the start the spring is relaxed.",
    matters: "When the knob reverses or jumps; what is added tends to strength times width, and is the whole stretch where a jump \
              is one step of the law.",
    looks: "Tilt over command is a loop that leads the command, and small swings make small loops inside the large one. Backlash \
            lags instead and has sharp corners, lag makes a loop that widens with frequency.",
    references: &[
        "Wen: Method for random vibration of hysteretic systems, J. Engineering Mechanics Division ASCE 102(2), 1976",
        "Ismail, Ikhouane, Rodellar: The hysteresis Bouc-Wen model, a survey, Archives of Computational Methods in Engineering 16, 2009",
    ],
};

#[derive(Clone)]
pub(crate) struct SpringHysteresis<S: Simd> {
    strength: Lanes<S>,
    width: Lanes<S>,
    jumps: Mask<S>,
    /// What was commanded last and what the spring holds then (rad).
    before: Option<(Pair<S>, Pair<S>)>,
}

impl<S: Simd> Effect<S> for SpringHysteresis<S> {
    fn new(simd: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            strength: values[0],
            width: values[1],
            jumps: values[2].gt(Lanes::splat(simd, 0.0)),
            before: None,
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, _: Lanes<S>) {
        let command = *knob;
        let (before, mut held) = self
            .before
            .unwrap_or((command, [self.width.like(0.0); 2]));
        for axis in 0..2 {
            let way = command[axis] - before[axis];
            // Most physics updates see no change.
            if way.ne(way.like(0.0)).any() {
                held[axis] = self.stretched(held[axis], way);
            }
            knob[axis] = command[axis] + self.strength * held[axis];
        }
        self.before = Some((command, held));
    }
}

impl<S: Simd> SpringHysteresis<S> {
    /// What the spring holds after a change of the command.
    #[inline(always)]
    fn stretched(&self, held: Lanes<S>, way: Lanes<S>) -> Lanes<S> {
        let (zero, one) = (way.like(0.0), way.like(1.0));
        let (mut jumped, mut passed) = (held, held);
        // A fit asks one answer of all lanes, and pays for that one alone.
        if self.jumps.any() {
            // One step takes no more than there is, so that a long one ends where it leads.
            let gives = (way.abs().over(self.width)).min(one);
            let left = (way * held).gt(zero).select(one - gives, one);
            jumped = held * left + way;
        }
        if (!self.jumps).any() {
            // What is held against the turn is let off first; then the rest of the turn stretches.
            let against = (way * held).lt(zero);
            let let_off = against.select(way.clamp(held.abs()), zero);
            let (slack, rest) = (held + let_off, way - let_off);
            let end = way.lt(zero).select(-self.width, self.width);
            passed = end + (slack - end) * (-rest.abs().over(self.width)).exp_decay();
        }
        self.jumps.select(jumped, passed)
    }
}
