//! Hysteresis of the cord's spring.

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
    noise: None,
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
            means: "angle that the spring adds to a small turn, relative to that turn; negative if it takes some away",
        },
        Parameter {
            name: "width_rad",
            unit: "rad",
            range: (0.005, 0.2),
            neutral: 0.05,
            allowed: (1e-6, 1e6),
            time_power: 0,
            optional: false,
            reach: None,
            means: "stretch at which the spring yields",
        },
        Parameter::choice(
            "jumps",
            1.0,
            "1 if each change of the command is one step of the model, as in a discrete simulator; 0 if the knob passes \
             through all angles of a turn",
        ),
    ],
    does: "Each turn stretches the cord and its spring, which pull the board farther than the knob alone would, until they \
           yield at their width. On the way back the stretch has to be released first. This is the Bouc-Wen model of \
           hysteresis, which depends on angles and not on time. At the start the spring is relaxed.",
    matters: "When the knob reverses or jumps. The added angle tends to strength times width. Where a jump is one step of the \
              model, a relaxed spring adds strength times the whole jump.",
    looks: "Tilt over command is a loop that leads the command; small swings make minor loops inside the large one. Backlash \
            lags instead and has sharp corners. A lag makes a loop that widens with frequency.",
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
    /// The last command and the spring's stretch then (rad).
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
    /// The spring's stretch after a change of the command.
    #[inline(always)]
    fn stretched(&self, held: Lanes<S>, way: Lanes<S>) -> Lanes<S> {
        let (zero, one) = (way.like(0.0), way.like(1.0));
        let (mut jumped, mut passed) = (held, held);
        // In a fit all lanes have the same choice, so only that branch is computed.
        if self.jumps.any() {
            // One step releases no more than the present stretch, so a long step ends at the limit.
            let gives = (way.abs().over(self.width)).min(one);
            let left = (way * held).gt(zero).select(one - gives, one);
            jumped = held * left + way;
        }
        if (!self.jumps).any() {
            // A stretch against the turn is released first; the rest of the turn stretches the spring.
            let against = (way * held).lt(zero);
            let let_off = against.select(way.clamp(held.abs()), zero);
            let (slack, rest) = (held + let_off, way - let_off);
            let end = way.lt(zero).select(-self.width, self.width);
            passed = end + (slack - end) * (-rest.abs().over(self.width)).exp_decay();
        }
        self.jumps.select(jumped, passed)
    }
}
