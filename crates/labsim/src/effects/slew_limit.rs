//! A limit on the knob's rate.

use pulp::Simd;

use super::{EffectSpec, Hook, Effect, Parameter, Stage, by_axis};
use crate::board::Rig;
use crate::lanes::Lanes;
use crate::motion::Pair;

pub(super) const ABOUT: EffectSpec = EffectSpec {
    name: "slew_limit",
    stage: Stage::Actuation,
    acts: Hook::OnKnob { moves: true },
    hypothesis: true,
    shrunk: false,
    noise: None,
    equation: "dθ/dt = rate × sgn(command - θ) until the command is reached",
    parameters: &[
        Parameter {
            name: "rate_rad_per_s",
            unit: "rad/s",
            range: (0.02, 2.0),
            neutral: f64::INFINITY,
            allowed: (0.0, f64::INFINITY),
            time_power: -1,
            optional: false,
            reach: None,
            means: "maximum rate of the knob; mean of both axes",
        },
        Parameter::y_minus_x("y_minus_x_rad_per_s", "rad/s", 1.0, 1e6, -1),
    ],
    does: "The knob turns towards its command at no more than the motor's maximum rate, and stops there.",
    matters: "Where the command changes faster than the rate: on steps, and on the steep parts of a sinusoid.",
    looks: "Only fast changes are distorted: steps of any size become ramps of equal slope, and sinusoids become triangles. \
            Half the amplitude at the same frequency may pass unchanged, which it never does with a lag.",
    references: &[
        "Klyde, McRuer, Myers: Pilot-induced oscillation analysis and prediction with actuator rate limiting, \
         J. Guidance, Control, and Dynamics 20(1), 1997",
    ],
};

#[derive(Clone)]
pub(crate) struct SlewLimit<S: Simd> {
    axes: [Axis<S>; 2],
    knob: Option<Pair<S>>,
    length: Lanes<S>,
}

/// One of the knob's angles.
#[derive(Clone)]
struct Axis<S: Simd> {
    rate: Lanes<S>,
    /// Maximum turn of the knob in a substep (rad), and its inverse.
    most: Lanes<S>,
    inverse: Lanes<S>,
}

impl<S: Simd> Effect<S> for SlewLimit<S> {
    fn new(simd: S, _: &Rig, values: &[Lanes<S>]) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            axes: by_axis(values[0], values[1]).map(|rate| Axis {
                rate: rate.max(zero),
                most: zero,
                inverse: zero,
            }),
            knob: None,
            length: zero,
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
            // Without a limit the maximum turn is infinite.
            self.length = length;
            for axis in &mut self.axes {
                axis.most = (axis.rate * length.max(1e-300 * one)).min(1e3 * one);
                axis.inverse = one.over(axis.most.max(1e-300 * one));
            }
        }
        for ((knob, turned), axis) in knob.iter_mut().zip(turned).zip(&self.axes) {
            let way = *knob - *turned;
            // The part of the substep in which the knob turns; after it the knob stands at its command.
            let turning = way.abs() * axis.inverse;
            let arrives = turning.le(one);
            let moved = arrives.select(way, way.clamp(axis.most));
            let unlimited = axis.rate.ge(length.like(f64::INFINITY));
            let on_average = arrives.select(*knob - 0.5 * turning * way, *turned + 0.5 * moved);
            *turned = arrives.select(*knob, *turned + moved);
            *knob = unlimited.select(*knob, on_average);
        }
    }
}
