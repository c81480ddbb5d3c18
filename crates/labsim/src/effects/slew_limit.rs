//! The knob turns no faster than its drive can.

use pulp::Simd;

use super::{About, Acts, Effect, Parameter, Stage};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: About = About {
    name: "slew_limit",
    stage: Stage::Actuation,
    acts: Acts::OnKnob { moves: true },
    equation: "dθ/dt = rate × sgn(command - θ) until the command is reached",
    parameters: &[Parameter {
        name: "rate_rad_per_s",
        unit: "rad/s",
        range: (0.02, 2.0),
        neutral: f64::INFINITY,
        allowed: (0.0, f64::INFINITY),
        time_power: -1,
        means: "the fastest that the knob turns",
    }],
    does: "The knob turns towards its command at a rate that its motor cannot exceed, and stops there.",
    matters: "Where the command changes faster than the rate: on steps, and on the steep stretches of a sinusoid.",
    looks: "Only the fast stretches suffer: steps become ramps of equal slope whatever their size, sinusoids become triangles. \
            Half the amplitude at the same frequency may pass untouched, which a lag never allows.",
    references: &[
        "Klyde, McRuer, Myers: Pilot-induced oscillation analysis and prediction with actuator rate limiting, \
         J. Guidance, Control, and Dynamics 20(1), 1997",
    ],
};

#[derive(Clone)]
pub(crate) struct SlewLimit<S: Simd> {
    rate: Lanes<S>,
    knob: Option<Pair<S>>,
    length: Lanes<S>,
    /// The most that the knob turns in a substep of that length (rad), and one over it.
    most: Lanes<S>,
    inverse: Lanes<S>,
}

impl<S: Simd> Effect<S> for SlewLimit<S> {
    fn new(simd: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            rate: values[0],
            knob: None,
            length: zero,
            most: zero,
            inverse: zero,
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
        let Some(turned) = &mut self.knob else {
            self.knob = Some(*knob);
            return;
        };
        let one = length.like(1.0);
        if length.ne(self.length).any() {
            // A knob without limit turns by more than there is.
            self.length = length;
            self.most = (self.rate * length.max(1e-300 * one)).min(1e3 * one);
            self.inverse = one.over(self.most.max(1e-300 * one));
        }
        for (knob, turned) in knob.iter_mut().zip(turned) {
            let way = *knob - *turned;
            // The part of the substep in which the knob turns; for the rest of it, it has arrived.
            let turning = way.abs() * self.inverse;
            let arrives = turning.le(one);
            let moved = arrives.select(way, way.clamp(self.most));
            let unlimited = self.rate.ge(length.like(f64::INFINITY));
            let on_average = arrives.select(*knob - 0.5 * turning * way, *turned + 0.5 * moved);
            *turned = arrives.select(*knob, *turned + moved);
            *knob = unlimited.select(*knob, on_average);
        }
    }
}
