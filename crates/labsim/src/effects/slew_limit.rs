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

pub(crate) struct SlewLimit<S: Simd> {
    rate: Lanes<S>,
    knob: Option<Pair<S>>,
}

impl<S: Simd> Effect<S> for SlewLimit<S> {
    fn new(_: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        Self {
            rate: values[0],
            knob: None,
        }
    }

    #[inline(always)]
    fn turn(&mut self, knob: &mut Pair<S>, length: Lanes<S>) {
        let Some(mut turned) = self.knob else {
            self.knob = Some(*knob);
            return;
        };
        let (zero, one) = (length.like(0.0), length.like(1.0));
        let limited = self.rate.lt(length.like(f64::INFINITY));
        let most = limited.select(self.rate, zero) * length;
        let per_way = one.over(most.max(length.like(1e-290)));
        for (knob, turned) in knob.iter_mut().zip(&mut turned) {
            let way = *knob - *turned;
            let moved = way.clamp(most);
            // The part of the substep in which the knob turns; for the rest of it, it has arrived.
            let turning = (way.abs() * per_way).min(one);
            let on_average = *turned + moved * (one - 0.5 * turning);
            *turned = limited.select(*turned + moved, *knob);
            *knob = limited.select(on_average, *knob);
        }
        self.knob = Some(turned);
    }
}
